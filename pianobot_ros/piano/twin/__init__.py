"""The MuJoCo twin of the cell: hand, keyboard and arm, its rollouts, and the reduced one-finger
strike model.
"""
