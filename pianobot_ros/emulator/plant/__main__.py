"""``python -m pianobot_ros.emulator.plant``: the plant as a process of its own."""

from __future__ import annotations

import os
import sys

# Before numpy is imported: its BLAS threads would spin on the second core, for matrices of four
# rows.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pianobot_ros.emulator.plant.live_plant import main

sys.exit(main())
