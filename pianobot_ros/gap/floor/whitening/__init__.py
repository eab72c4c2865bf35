"""Noise by which residuals are whitened: its filter, and what is another in each block."""
