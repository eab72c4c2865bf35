"""Examples that bring another robot to the diagnosis."""
