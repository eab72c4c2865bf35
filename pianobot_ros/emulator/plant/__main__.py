"""``python -m pianobot_ros.emulator.plant``: the plant as a process of its own."""

from __future__ import annotations

import sys

from pianobot_ros.emulator.plant.live_plant import main

sys.exit(main())
