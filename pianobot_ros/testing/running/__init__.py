"""What a test lets run: processes, emulated devices, a context, the whole cell."""
