"""The simulated cell as a node."""
