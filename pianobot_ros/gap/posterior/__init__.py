"""From held-out scores to probabilities and a verdict."""
