"""The servo axis as a twin of the engine, and what it predicts of logs and motions."""
