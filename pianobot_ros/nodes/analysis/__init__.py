"""Nodes that compute for long: diagnosis, investigation, identification."""
