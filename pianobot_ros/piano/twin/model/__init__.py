"""The MuJoCo model: hand, keyboard, arm, and the cell that they make."""
