"""Effects of the pneumatics: between setpoint and pressure."""
