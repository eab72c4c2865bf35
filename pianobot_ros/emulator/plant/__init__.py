"""The plant behind the emulated devices: a second implementation of the cell, apart from the twin, with effects to inject."""
