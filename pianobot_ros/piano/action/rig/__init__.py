"""The voice-coil rig: linear models, transfer functions, their fit, and the load cell."""
