"""The hardware nodes, one for each device."""
