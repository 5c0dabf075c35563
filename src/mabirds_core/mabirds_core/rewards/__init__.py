"""Reward models r_theta."""
