"""Slow, readable twins of the kernels, with the same signatures."""
