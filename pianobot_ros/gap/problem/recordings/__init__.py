"""What of recordings can be used, and what in them is of no robot."""
