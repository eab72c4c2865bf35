"""Columns of the arrays that the compiled mechanics work on.

A finger, a key and the cell are each a row of numbers rather than an object with arrays: compiled
code then never counts references, which made two thirds of its time.
"""

from __future__ import annotations

# Constants of a finger, array (3, FINGER_CONSTANTS).
COUNT = 0  # phalanges
YAW = 1  # rad
RADIUS = 2  # m, fingertip
BASE = 3  # 3: m, wrist frame
LENGTH = 6  # 4: m
MOMENT = 10  # 4: kg m, what a uniform acceleration acts on
REST = 14  # 4: rad, joint angles at rest
INERTIA = 18  # 4 x 4: kg m^2, M_ij = INERTIA_ij cos(phi_i - phi_j)
FINGER_CONSTANTS = 34

# Constants of a key, array (12, KEY_CONSTANTS).
LEFT, RIGHT, FRONT, REAR = 0, 1, 2, 3  # m, edges of its surface in the base frame
TOP = 4  # m, surface above the hinge's axis
KEY_INERTIA = 5  # kg m^2
KEY_RADIUS = 6  # m, r of Eq. 2
KEY_CONSTANTS = 7

# State of a finger, array (3, FINGER_STATE).
PHI = 0  # 4: rad, absolute pitch of each phalanx
RATE = 4  # 4: rad/s
CHANGE = 8  # 4: rad/s, last step's change of rate
ABDUCTION = 12  # 3: angle, rate, last change
ADHESION = 15  # how well the pad sticks, 0 to 1
CLEAR = 16  # s since the finger last touched a key; negative: variation to be drawn
HEIGHT = 17  # m, this strike's offset, now
HEIGHT_AIM = 18  # m
STIFFNESS_OFF = 19  # this strike's relative departure
DAMPING_OFF = 20
STIFFNESS = 21  # N m/rad, of every joint now
JAM = 22  # Pa, memory of the pressure path
BRISTLE = 23  # 4: rad, joint friction
SLIDERS = 27  # 3 x 4: rad, granular yield elements
CREEP = 39  # 3 x 4: rad
TOUCH = 51  # 12 x 2: m, tangential spring of the pad on each key
FATIGUE = 75  # share of the grains that presses have moved
DEEPEST = 76  # m, what the pad remembers as its deepest compression
GAP = 77  # 4: rad, where a joint stands in its play
MAXWELL = 81  # 3 x 4: rad, springs of the joint's friction
FINGER_STATE = 93

# State of a key, array (12, KEY_STATE).
ANGLE, SPEED, SPEED_CHANGE = 0, 1, 2  # rad, rad/s
KEY_BRISTLE = 3  # rad
HAMMER, HAMMER_SPEED = 4, 5  # rad, rad/s
SUNK = 6  # m, taken up by a loose hinge
SOUNDING = 7  # 0 or 1
NORMAL = 8  # N, sum of contact normal forces
TORQUE = 9  # N m, of the fingers
KEY_FELT = 10  # relative force that a relaxing felt has lost
FELT_SET = 11  # rad by which the bottom felt stays pressed
GREASE = 12  # structure of the bushing's grease, 0 to 1
KEY_STATE = 13

# State of the cell, array (CELL_STATE,).
REACTION = 0  # 3: N, of the keys on the wrist, mean over the tick
DRAWS = 3  # random numbers drawn
SAG = 4  # m, palm
CELL_STATE = 5
