"""Effects of the contact: at the fingertip's pad."""
