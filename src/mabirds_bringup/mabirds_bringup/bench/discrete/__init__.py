"""``mabirds bench discrete``: the evader-patroller experiment, all methods and variations side by side."""
