"""What the emulated controller is reached by: RTDE, the dashboard, and their server."""
