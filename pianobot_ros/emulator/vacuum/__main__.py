"""``python -m pianobot_ros.emulator.vacuum``."""

import sys

from pianobot_ros.emulator.vacuum.device import main

sys.exit(main())
