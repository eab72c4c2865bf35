"""Effects of the key and its action."""
