"""What is around a joint: the robot's other joints, surroundings, and what is carried."""
