"""The piano cell's own side, as ``axis`` is a robot joint's: its models, their identification, the
piano as a twin of the engine ``gap``, the blind check, and what the browser shows.
"""
