"""What parameters reveal of the demonstrations that they were learned from."""
