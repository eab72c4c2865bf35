"""Files of arrays, each with a name."""
