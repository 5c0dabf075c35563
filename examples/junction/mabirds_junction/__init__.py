"""Vehicles that meet at a junction and may wait: a game for MA-BIRDS from outside."""
