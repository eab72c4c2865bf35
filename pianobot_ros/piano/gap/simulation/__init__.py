"""The piano cell's twin: what it says of itself and predicts of a strike."""
