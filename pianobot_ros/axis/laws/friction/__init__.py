"""Friction: against the motion, by speed, load, direction, history and warmth."""
