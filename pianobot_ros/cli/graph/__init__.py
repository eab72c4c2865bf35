"""Commands that start a graph, play on it, watch it or prepare for it."""
