"""What the machine gives to its processes: clocks, scheduling classes, names that one may have, and
an end in order.
"""
