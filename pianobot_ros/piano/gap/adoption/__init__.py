"""What a diagnosis found, taken over by the twin: live, and as MJCF."""
