"""The plant behind the emulated devices: a second implementation of the cell, apart from the twin,
with effects to inject.
"""

from pathlib import Path

from pianobot_ros.cell.host.compiled_code import forget_stale_code

forget_stale_code(Path(__file__).resolve().parent)
