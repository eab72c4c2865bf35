"""Four small robots that were written by somebody who had not read the engine: what a user of
`pianobot_ros.gap` would write for them, and a plant of each by other laws and another integrator.

A robot's ``*_twin.py`` is the twin. Its ``*_plant.py`` records blocks, with a law of the plant at
work or without. ``case_table.py`` holds which cases there are, ``drawing.py`` draws one.
"""
