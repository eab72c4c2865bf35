"""The drivetrain of a small wheeled robot."""
