"""From measured data to the twin's parameters (soft-hand-piano-simulator.txt, section III)."""
