"""Effects of the wrist: between command and wrist motion."""
