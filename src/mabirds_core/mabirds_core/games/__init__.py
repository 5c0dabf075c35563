"""Constrained Markov games: the interface, and one file per game."""
