"""What the columns of a table are: time, joint, quantity, unit and sign."""
