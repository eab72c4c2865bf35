"""First values from the logs themselves, before any hypothesis is fitted."""
