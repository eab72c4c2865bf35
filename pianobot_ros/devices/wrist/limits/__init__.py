"""What the arm may do: how each setpoint is bent to it, and what is given after a hold-up."""
