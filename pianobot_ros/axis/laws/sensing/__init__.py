"""Position sensor, effort and clocks as the log has them."""
