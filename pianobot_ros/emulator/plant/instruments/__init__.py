"""What stands between the mechanics and the devices: arm, regulators, sensors, their noise."""
