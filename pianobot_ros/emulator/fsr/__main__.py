"""``python -m pianobot_ros.emulator.fsr``."""

import sys

from pianobot_ros.emulator.fsr.device import main

sys.exit(main())
