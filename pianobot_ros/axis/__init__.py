"""Any joint's log, from any robot: reading it, a twin of one axis with its laws, and the diagnosis.

The second customer of the engine in `gap`, beside the piano cell.
"""
