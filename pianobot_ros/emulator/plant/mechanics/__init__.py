"""Fingers and keys: forces, equations of motion, and their integrator, compiled."""
