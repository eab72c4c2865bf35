"""The key by itself: load tests, the fit to their presses, stiffness and stop."""
