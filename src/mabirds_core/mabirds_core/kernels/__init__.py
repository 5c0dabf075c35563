"""Compiled kernels: loops of the learning path in C, with the same bits on every processor."""
