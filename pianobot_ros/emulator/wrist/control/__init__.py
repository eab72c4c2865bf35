"""The emulated controller: program, registers, safety, and the variables that it reports."""
