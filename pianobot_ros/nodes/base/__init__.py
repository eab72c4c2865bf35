"""What every node is built on: parameters, diagnostics, life cycle, start and end."""
