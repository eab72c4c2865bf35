"""The words of many laboratories for what a column may be."""

from __future__ import annotations


def words_of(words: str) -> frozenset[str]:
    """The words that stand in one text."""
    return frozenset(words.split())


EFFORTS = {
    "Nm": words_of(
        "torque torques qtorque qtau tau moment moments trq tq tor drehmoment couple coppia"
    ),
    "N": words_of("force forces kraft"),
    "A": words_of(
        "current currents curr cur iq amp amps strom motorstrom courant corriente corrente"
    ),
    "%": words_of("pwm duty percent"),
}
"""Words of an effort by the unit that it then has."""
WORDS: dict[str, frozenset[str]] = {
    "time": words_of(
        "time timestamp timestamps stamp t ts sec secs second seconds nsec nsecs nanosec"
        " nanoseconds usec micros microseconds msec millis milliseconds usecs msecs nanosecond"
        " microsecond millisecond clock elapsed date"
        " datetime epoch duration zeit zeitstempel uhrzeit datum tiempo"
    ),
    "position": words_of(
        "position positions pos posn angle angles ang q qpos theta phi enc encoder encoders"
        " displacement stroke travel distance extension lage winkel weg posicion posizione"
    ),
    "velocity": words_of(
        "velocity velocities vel vels speed speeds qd dq omega qdot dtheta qvel thetad thetadot"
        " xdot ydot zdot phidot rpm erpm rate velo geschwindigkeit geschw drehzahl vitesse"
        " velocidad velocita tachometer"
    ),
    "effort": words_of("effort efforts eff duty pwm load loads strom").union(*EFFORTS.values()),
    "acceleration": words_of(
        "acceleration accelerations acc accel qdd ddq qddot qacc ddot xddot yddot zddot ddtheta"
        " thetadd thetadotdot qdotdot jerk beschleunigung"
    ),
    "error": words_of(
        "error errors err perr deviation following diff schleppfehler schleppabstand fehler"
    ),
    "enable": words_of("enable enabled"),
    "episode": words_of("episode trial run rep repetition demo env traj"),
}
WITHIN = WORDS["time"] | words_of("step steps frame frames length reward done")
"""Words of what goes on within a run, beside which a word like "run" is not its number."""
COMMAND = words_of(
    "command commands commanded cmd cmds target targets goal goals setpoint setpoints set sp"
    " desired des planned leader ref reference references demand demanded nominal action actions"
    " wanted control ctrl soll sollwert req request requested consigne consigna deseada deseado"
)
ACTUAL = words_of(
    "actual act measured meas present state observation observations obs feedback fb fbk fdb real"
    " sensed estimate estimated est follower ist istwert mesure mesuree medido medida misurata"
)
MEASURED = words_of("actual act measured meas real fb fbk feedback ist istwert")
"""Those that set what was measured apart from what was to be."""
STATES = frozenset({"state", "states"})
PLANNED = words_of("input trajectory profile")
"""Words of a command, beside a position that was measured."""
COMPUTED = words_of("cal calc calculated computed cmptd comptd")
CALCULATED = COMPUTED | words_of("model modelled modeled predicted theoretical")
"""Words of an effort that nothing measured; and of a motion, beside the one that was measured."""
BODIES = words_of("eef effector root quat cos sin")
"""Words of what is no joint's own: a body's place, a function of an angle."""
OTHER = BODIES | words_of(
    "tcp tool pose cartesian ee quaternion orientation imu gyro gyr gyroscope accelerometer"
    " magnetometer digital analog bits mode status safety seq frame task checksum battery bus"
    " supply voltage voltages volt volts temp temps temperature temperatures momentum power mass"
    " gain kp kd ki std cov covariance variance id header valid quality event type wrench"
    " gripper_force unix name names stiffness damping inertia payload ext external hat override"
    " reactive"
)
"""Headers with these words are no role, whatever else they say."""
GROUPS = frozenset({"status"})
"""Words that say nothing of what is a part of it (`StatusTorqueData.ActualTorque`)."""
FILLERS = words_of(
    "field data msg msgs message joint joints motor motors servo servos axis axes robot arm value"
    " values signal signals column csv log raw filtered dof topic of the in and recorded recording"
    " j m states tracking deg rad degrees radians index achse controller applied actuator actuators"
    " mot link antrieb abtrieb rotor active generating producing logger device interface"
)
LIMBS = words_of(
    "joints motors servos axes base torso waist lift shoulder elbow forearm wrist hand finger thumb"
    " gripper neck head hip thigh knee calf ankle foot leg arm pan tilt yaw pitch roll"
)
"""Words of which one says that a name is a joint's."""
JOINTS = words_of("joint motor servo axis achse gelenk j drive antrieb")
"""Words that a joint's number stands behind."""
CLOCKS = words_of("time timestamp timestamps stamp stamps")
FIELD = frozenset({("i", "d"), ("u", "d"), ("v", "d"), ("u", "q"), ("v", "q")})
"""What is beside the current `iq` of a motor's field: the other axis, voltages."""
VOLTAGES = words_of("voltage voltages volt volts vm")
SUPPLY = words_of("bus vbus dcbus supply battery batt")
"""Words of a voltage that is there whatever the motor does."""
LOWEST = 5
"""Rank of a motor's voltage, which is an effort only where none was measured."""
OUTPUT = words_of("output outputs out")
"""What a controller puts out is an effort, where nothing else in a header says what it is."""
LETTERS = {"p": "position", "q": "position", "v": "velocity", "i": "current"}
"""First letters of words like `pcmd` and `ifbk`."""
FOREIGN = "foreign"
"""Quantity of what is known to be no joint's."""
SINGLE = {
    "x": "position",
    "y": "position",
    "z": "position",
    "v": "velocity",
    "w": "velocity",
    "i": "effort",
    "f": "effort",
    "u": "effort",
    "e": "error",
    "r": "position",
    "th": "position",
}
"""Single letters, where nothing else in a header says what it is; `r` is a command."""
ESTIMATES = {("pos", "estimate"), ("vel", "estimate")}
ODRIVE = ESTIMATES | {("input", "pos"), ("input", "vel"), ("iq", "setpoint"), ("iq", "measured")}
"""What ODrive calls its properties."""
MOTEUS = tuple(map(words_of, ("position", "velocity", "torque torque_nm", "q_current q_a")))
"""What moteus calls its registers, in one way or another."""
TURNED = words_of("angle angles angular ang theta phi winkel")
"""Positions that are no length, whatever drives them."""
ANGLES = TURNED | words_of("q qpos")
"""The same of a robot's joints; an axis that slides may have a `q` too."""
DIRECTIONS = frozenset("xyz")
"""Letters that are also a joint's name, where a table has two of them."""
SYMBOLS = frozenset({"theta", "phi"})
"""Angles that are also a joint's name, where a table has two of them, or one beside x."""
LETTER = 5
"""Rank of what only a single letter says."""
BARE = 9
"""Rank of a position that only words like "actual" or "state" tell of, or a joint's name."""
MOTOR = words_of("motor motors mot antrieb rotor")
