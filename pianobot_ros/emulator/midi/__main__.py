"""``python -m pianobot_ros.emulator.midi``."""

import sys

from pianobot_ros.emulator.midi.device import main

sys.exit(main())
