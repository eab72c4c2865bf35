"""The model for others: MJCF for stock MuJoCo, and pictures."""
