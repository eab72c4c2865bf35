"""Drivers of the cell's devices, each a folder, behind the protocol in ``base``."""
