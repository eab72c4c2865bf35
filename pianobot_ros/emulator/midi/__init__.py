"""The emulated digital piano, a process of its own."""
