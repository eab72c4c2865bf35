"""Command, position loop and motor: delays, limits, and torque that is not what was asked."""
