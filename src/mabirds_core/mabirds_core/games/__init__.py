"""Constrained Markov games: the interface, and one file a game."""
