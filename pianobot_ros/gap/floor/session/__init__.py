"""What in the scatter of repeats follows a clock, and is therefore none: drifts of the session, and
disturbances on clocks of their own.
"""
