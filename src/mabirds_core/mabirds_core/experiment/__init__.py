"""Experiment files, what is built from them, and the in-process network."""
