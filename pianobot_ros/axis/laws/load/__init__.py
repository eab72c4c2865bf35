"""What the motor moves: transmission, gravity, payload, surroundings."""
