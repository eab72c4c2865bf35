"""A second plant of the cell, written by somebody who had not read the library of laws: a piano key
that is struck by the middle finger, with its own mechanics, laws, sensors and draws.

It shares with the emulator the nominal numbers of ``config/``, the levels of noise and the planned
strikes. ``benchmarks/blind_foreign_cell.py`` draws blind cases from it and has them diagnosed.
"""

from pathlib import Path

from pianobot_ros.cell.host.compiled_code import forget_stale_code

forget_stale_code(Path(__file__).resolve().parent)
