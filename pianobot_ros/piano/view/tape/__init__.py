"""What is known of a cell on one time axis, from a running graph or a bag."""
