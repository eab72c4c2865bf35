"""Where hand and keys are, and how the wrist may move: geometry, rotations, limits, strikes."""
