"""The emulated arm in motion: kinematics, reference trajectories, servo."""
