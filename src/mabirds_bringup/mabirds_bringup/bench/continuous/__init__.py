"""``mabirds bench continuous``: the experiment with drones, all methods and both ways to find policies."""
