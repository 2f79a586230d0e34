"""Numba: kernels, what they share, and the folder that keeps their machine code."""
