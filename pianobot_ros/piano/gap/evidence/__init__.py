"""Recordings as blocks for the diagnosis: what can be used, and on which clock."""
