"""A robot-piano cell as a ROS 2 node graph with a simulated twin, and a diagnosis of the gap
between the two.
"""

import os
from pathlib import Path

from pianobot_ros.cell.host.compiled_code import folder_of_compiled_code

# Before numpy is imported, wherever we are: our matrices have a few rows, and further threads of
# BLAS would only spin on cores that other work needs (twice the CPU time for the same wall time).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Before numba is.
os.environ.update(folder_of_compiled_code(Path(__file__).resolve().parent))

__version__ = "0.2.0"
