"""What every emulated device's process needs: shared memory with the plant, ports, its parent."""
