"""The evader-patroller game (paper, section 5.1)."""
