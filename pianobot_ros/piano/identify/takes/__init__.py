"""Takes, strikes with the twin's model ready to play them, and what they are compared by."""
