"""From measured data to the twin's parameters ("Data-driven Simulation Framework", section III)."""
