"""The emulated force sensor and key encoder, a process of its own."""
