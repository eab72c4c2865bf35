"""The emulated vacuum regulator, a process of its own."""
