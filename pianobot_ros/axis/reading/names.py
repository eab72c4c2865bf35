"""What a header says: quantity, commanded or measured, joint and unit, in the words of many
laboratories.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from unicodedata import combining, normalize


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


EFFORTS = {
    "Nm": _set(
        "torque torques qtorque qtau tau moment moments trq tq tor drehmoment couple coppia"
    ),
    "N": _set("force forces kraft"),
    "A": _set("current currents curr cur iq amp amps strom motorstrom courant corriente corrente"),
    "%": _set("pwm duty percent"),
}
"""Words of an effort by the unit that it then has."""
WORDS: dict[str, frozenset[str]] = {
    "time": _set(
        "time timestamp timestamps stamp t ts sec secs second seconds nsec nsecs nanosec"
        " nanoseconds usec micros microseconds msec millis milliseconds usecs msecs nanosecond"
        " microsecond millisecond clock elapsed date"
        " datetime epoch duration zeit zeitstempel uhrzeit datum tiempo"
    ),
    "position": _set(
        "position positions pos posn angle angles ang q qpos theta phi enc encoder encoders"
        " displacement stroke travel distance extension lage winkel weg posicion posizione"
    ),
    "velocity": _set(
        "velocity velocities vel vels speed speeds qd dq omega qdot dtheta qvel thetad thetadot"
        " xdot ydot zdot phidot rpm erpm rate velo geschwindigkeit geschw drehzahl vitesse"
        " velocidad velocita tachometer"
    ),
    "effort": _set("effort efforts eff duty pwm load loads strom").union(*EFFORTS.values()),
    "acceleration": _set(
        "acceleration accelerations acc accel qdd ddq qddot qacc ddot xddot yddot zddot ddtheta"
        " thetadd thetadotdot qdotdot jerk beschleunigung"
    ),
    "error": _set(
        "error errors err perr deviation following diff schleppfehler schleppabstand fehler"
    ),
    "enable": _set("enable enabled"),
    "episode": _set("episode trial run rep repetition demo env traj"),
}
WITHIN = WORDS["time"] | _set("step steps frame frames length reward done")
"""Words of what goes on within a run, beside which a word like "run" is not its number."""
COMMAND = _set(
    "command commands commanded cmd cmds target targets goal goals setpoint setpoints set sp"
    " desired des planned leader ref reference references demand demanded nominal action actions"
    " wanted control ctrl soll sollwert req request requested consigne consigna deseada deseado"
)
ACTUAL = _set(
    "actual act measured meas present state observation observations obs feedback fb fbk fdb real"
    " sensed estimate estimated est follower ist istwert mesure mesuree medido medida misurata"
)
MEASURED = _set("actual act measured meas real fb fbk feedback ist istwert")
"""Those that set what was measured apart from what was to be."""
STATES = frozenset({"state", "states"})
PLANNED = _set("input trajectory profile")
"""Words of a command, beside a position that was measured."""
COMPUTED = _set("cal calc calculated computed cmptd comptd")
CALCULATED = COMPUTED | _set("model modelled modeled predicted theoretical")
"""Words of an effort that nothing measured; and of a motion, beside the one that was measured."""
BODIES = _set("eef effector root quat cos sin")
"""Words of what is no joint's own: a body's place, a function of an angle."""
OTHER = BODIES | _set(
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
FILLERS = _set(
    "field data msg msgs message joint joints motor motors servo servos axis axes robot arm value"
    " values signal signals column csv log raw filtered dof topic of the in and recorded recording"
    " j m states tracking deg rad degrees radians index achse controller applied actuator actuators"
    " mot link antrieb abtrieb rotor active generating producing logger device interface"
)
LIMBS = _set(
    "joints motors servos axes base torso waist lift shoulder elbow forearm wrist hand finger thumb"
    " gripper neck head hip thigh knee calf ankle foot leg arm pan tilt yaw pitch roll"
)
"""Words of which one says that a name is a joint's."""
JOINTS = _set("joint motor servo axis achse gelenk j drive antrieb")
"""Words that a joint's number stands behind."""
CLOCKS = _set("time timestamp timestamps stamp stamps")
FIELD = frozenset({("i", "d"), ("u", "d"), ("v", "d"), ("u", "q"), ("v", "q")})
"""What is beside the current `iq` of a motor's field: the other axis, voltages."""
VOLTAGES = _set("voltage voltages volt volts vm")
SUPPLY = _set("bus vbus dcbus supply battery batt")
"""Words of a voltage that is there whatever the motor does."""
LOWEST = 5
"""Rank of a motor's voltage, which is an effort only where none was measured."""
OUTPUT = _set("output outputs out")
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
MOTEUS = tuple(map(_set, ("position", "velocity", "torque torque_nm", "q_current q_a")))
"""What moteus calls its registers, in one way or another."""
TURNED = _set("angle angles angular ang theta phi winkel")
"""Positions that are no length, whatever drives them."""
ANGLES = TURNED | _set("q qpos")
"""The same of a robot's joints; an axis that slides may have a `q` too."""
DIRECTIONS = frozenset("xyz")
"""Letters that are also a joint's name, where a table has two of them."""
SYMBOLS = frozenset({"theta", "phi"})
"""Angles that are also a joint's name, where a table has two of them, or one beside x."""
LETTER = 5
"""Rank of what only a single letter says."""
BARE = 9
"""Rank of a position that only words like "actual" or "state" tell of, or a joint's name."""
UNITS = {
    "rad": "rad radian radians",
    "deg": "deg degree degrees grad °",
    "turn": "turn turns rev revs revolution revolutions rot rots rotation rotations",
    "m": "m meter meters metre metres",
    "mm": "mm millimeter millimeters millimetre millimetres",
    "cm": "cm",
    "um": "um µm μm micron microns",
    "1000/rad": "mrad millirad millirads milliradian milliradians",
    "1000000/rad": "urad µrad μrad microrad microrads microradian microradians",
    "1000/deg": "mdeg millideg millidegs millidegree millidegrees",
    "100/deg": "cdeg centideg centidegs centidegree centidegrees",
    "60/deg": "arcmin arcmins arcminute arcminutes",
    "3600/deg": "arcsec arcsecs arcsecond arcseconds",
    "400/turn": "gon gons",
    "1000000000/m": "nanometer nanometers nanometre nanometres",
    "39.37007874/m": "in inch inches",
    "rad/s": "rad/s rads radps rad_s rad/sec rad.s-1 rad*s^-1",
    "deg/s": "deg/s degs degps deg_s deg/sec °/s dps",
    "rpm": "rpm 1/min min-1 min^-1 u/min tr/min r/min rev/min revs/min",
    "erpm": "erpm",
    "turn/s": "rev/s revs/s turn/s turns/s rot/s rps",
    "m/s": "m/s mps",
    "mm/s": "mm/s mmps",
    "m/min": "m/min",
    "mm/min": "mm/min",
    "Nm": "nm newtonmeter newtonmeters newtonmetre newtonmetres",
    "mNm": "mnm nmm",
    "cNm": "cnm ncm",
    "kNm": "knm",
    "uNm": "unm µnm μnm",
    "kgfcm": "kgfcm kgcm",
    "ozin": "ozin ozfin inoz",
    "lbin": "lbin lbfin inlb inlbf",
    "lbft": "lbft lbfft ftlb ftlbf",
    "N": "n newton newtons",
    "kN": "kn",
    "daN": "dan",
    "lbf": "lbf",
    "A": "a amp amps ampere amperes",
    "mA": "ma milliamp milliamps",
    "V": "v volt volts",
    "%": "% percent pct perc prozent",
    "‰": "‰ permille permil promille 1/1000",
    "s": "s sec secs second seconds",
    "ms": "ms msec millis millisec millisecs millisecond milliseconds",
    "us": "us micros usec µs μs microsec microsecs microsecond microseconds",
    "ns": "ns nsec nsecs nanosec nanosecs nanosecond nanoseconds",
    "min": "min mins minute minutes",
    "h": "h hr hrs hour hours",
    "counts": "counts count ticks tick cnt cts inc lsb steps pulse pulses",
}
NANOMETRES = "1000000000/m"
NANO = re.compile(r"[\[(]nm[\])]")
"""Of a length; of a moment it is written so, too."""
_UNIT_OF = {word: unit for unit, words in UNITS.items() for word in words.split()}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in a unit of time."""
_QUANTITY_OF = {
    **dict.fromkeys(
        ("rad/s", "deg/s", "rpm", "turn/s", "m/s", "mm/s", "m/min", "mm/min"), "velocity"
    ),
    **dict.fromkeys(("Nm", "mNm", "cNm", "kNm", "uNm", "N", "kN", "A", "mA"), "effort"),
}
_IN_NAMES = {
    "position": _set(
        "deg degree degrees grad rad radian radians turn turns rev mm cm um m counts ticks tick"
        " pulse pulses mrad urad mdeg cdeg millideg arcmin arcsec inch inches"
    ),
    "velocity": _set("rpm erpm rads degs dps radps mps mmps"),
    "effort": _set("nm mnm cnm ncm nmm n kn a ma percent pct amp amps ‰ permille permil promille"),
    "time": _set(
        "s ms us ns sec secs second seconds msec msecs millis usec usecs micros nsec nsecs nanosec"
        " milliseconds microseconds nanoseconds millisecond microsecond nanosecond"
    ),
}


_PARTS = _set("nano micro milli")
_CURRENT = re.compile(r"I(?!d)[a-z]_?(\d*)_?([A-Za-z]*)")
"""Currents as drives' papers call them: `Im`, `Iz1`, `Iz1_ref`."""
_MOMENT = re.compile(
    r"(?<![A-Za-z])M(?=_(?i:mot|ist|soll|an|act|ref|des|cmd|meas|\d+)(?![A-Za-z]))"
)
"""Torques as Europeans' formulas call them: `M_mot`, `M_ist`."""
_STAR = re.compile(r"(?<=[A-Za-z])\*(?=$|[\s_(\[,;])")
"""What is wanted, as papers on drives write it: `theta*`."""
_TYPED = re.compile(r"(?<![A-Za-z])(?:lr|[fnibdw])(?=([A-Z][a-z]+)[A-Z])")
"""Letters of a type before what programs of PLCs call their variables: `fIstPosition`."""
_TREE = re.compile(r"^model root/", re.IGNORECASE)
"""The root of a Simulink model, as dSPACE's programs call what they record."""
_SENT = {
    "AIPos": "actual position",
    "ASPos": "set position",
    "EIPos": "actual position ext",
    "ESPos": "set position ext",
    "MACur": "motor current",
    "MECur": "motor current ext",
    "feedBack": "feedback",
    "qfrc_actuator": "effort actuator",
    "RIst": "cartesian",
    "RSol": "cartesian",
}
"""What KUKA's sensor interface calls positions of its axes, currents and poses; ABB's and MuJoCo's
words.
"""
_EASTERN = {
    "time": "时间 時間 时刻 時刻 时间戳",
    "position": "位置 角度 转角 位移 変位",
    "velocity": "角速度 速度 转速 回転速度 回転数",
    "acceleration": "角加速度 加速度",
    "torque": "转矩 扭矩 力矩 トルク",
    "current": "电流 電流",
    "error": "误差 誤差 偏差",
    "target": "目标 目標 期望 指令 给定 设定 設定",
    "actual": "实际 実際 现在 現在 当前 反馈 测量 測定 実測",
    "joint": "关节 関節 电机 モータ モーター 轴 軸",
}
"""Words of Chinese and Japanese, which are written without spaces, by what they are here."""
_FROM_EASTERN = {word: here for here, words in _EASTERN.items() for word in words.split()}
_EAST = re.compile("|".join(sorted(_FROM_EASTERN, key=len, reverse=True)))
_TIMES = re.compile(r"[x×]?(?:10\^(-?\d+)|(\d*[.,]?\d+(?:e[-+]?\d+)?))[*x×·]?([^\d.,\s].*)")
"""A number of units: `0.1rpm`, `10^-4deg`."""
_OF_ONE = re.compile(r"(\d+(?:\.\d*)?(?:e[-+]?\d+)?)\s*/\s*(\S+)")
_PER_MILLE = re.compile(r"(?<![a-z])per[ _-]?mill?e?(?![a-z])")
OBJECTS: dict[int, tuple[str, bool, str]] = {
    0x6062: ("position", True, ""),
    0x6063: ("position", False, ""),
    0x6064: ("position", False, ""),
    0x6069: ("velocity", False, ""),
    0x606B: ("velocity", True, ""),
    0x606C: ("velocity", False, ""),
    0x6071: ("effort", True, "‰"),
    0x6074: ("effort", True, "‰"),
    0x6077: ("effort", False, "‰"),
    0x6078: ("effort", False, "‰"),
    0x607A: ("position", True, ""),
    0x60F4: ("error", False, ""),
    0x60FC: ("position", True, ""),
    0x60FF: ("velocity", True, ""),
}
"""Quantity, whether commanded, and unit of objects of the drive profile CiA 402 by their index."""
AGAIN = {0x6063: 1, 0x6069: 2, 0x6071: 1, 0x6078: 1, 0x607A: 1, 0x60FC: 2}
"""Ranks of objects that say again what another one says: raw, or before the ramp."""
_INDEX = re.compile(
    r"(?<![0-9a-z])(?:0x|16#)?(6[0-9a-f]{3})h?(?:[:._ ](?:0x)?00?h?)?(?![0-9a-z])", re.IGNORECASE
)
IDENTS: dict[int, tuple[str, bool]] = {
    36: ("velocity", True),
    40: ("velocity", False),
    47: ("position", True),
    51: ("position", False),
    53: ("position", False),
    80: ("effort", True),
    84: ("effort", False),
    189: ("error", False),
}
"""Quantity, and whether commanded, of standard data of Sercos drives by the number in `S-0-0051`;
51 is read at the motor, 53 at what it moves, where both are there.
"""
AT_MOTOR, AT_LOAD = 51, 53
_IDENT = re.compile(
    r"(?<![0-9a-z])[sp]-[0-9]-([0-9]{4})(?:\.[0-9]+){0,2}(?![0-9a-z])", re.IGNORECASE
)
_COMPOUND = re.compile(r"\w{3,}?(strom|moment|drehzahl|geschwindigkeit|winkel|kraft)")
"""German compounds are what their last word says (`ausgangsstrom`)."""
_BESIDE_TIME = _set("ext external id type")
_DRIVEN = _set("control controller ctrl pid % percent")
_BESIDE_SYMBOL = COMMAND | ACTUAL | FILLERS | (WORDS["position"] - SYMBOLS) | set(_UNIT_OF)
_DIGITS = frozenset(map(str, range(64)))
_KNOWN = frozenset().union(*WORDS.values(), COMMAND, ACTUAL, OTHER, FILLERS) - {"the", "temp"}


@dataclass(frozen=True)
class Meaning:
    """What one column seems to be; `rank` orders columns that seem to be the same (lower wins)."""

    header: str
    quantity: str = "other"
    command: bool = False
    joint: str = ""
    unit: str = ""
    rank: int = 0

    @property
    def role(self) -> str:
        """Role in a log: time, command, position, motor, velocity, effort, error, enable, episode,
        foreign or other.
        """
        if self.command:
            return {"position": "command", "effort": "command effort"}.get(self.quantity, "other")
        return self.quantity


LONGEST = 300
"""Characters of a header that are read: a longer one is no name but data."""


def tokens(header: str) -> list[str]:
    """Lower-case words of a header, digits apart: `actualPos_Joint1` is actual, pos, joint, 1."""
    header = header[:LONGEST]
    current = _CURRENT.fullmatch(header)
    if current and current[2].lower() in COMMAND | ACTUAL | {""}:
        header = f"iq {current[1]} {current[2]}"
    header = _EAST.sub(lambda m: f" {_FROM_EASTERN[m[0]]} ", _TREE.sub("", header))
    header = re.sub("|".join(_SENT), lambda m: _SENT[m[0]], header)
    header = _MOMENT.sub("moment", header)
    header = _STAR.sub(" star", header)
    header = _TYPED.sub(lambda m: "" if m[1].lower() in COMMAND | ACTUAL else m[0], header)
    split = re.sub(r"(?<![A-Za-z])(mA|kN|[mcku]Nm|mN)(?![A-Za-z])", lambda m: m[0].lower(), header)
    split = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", split)
    split = re.sub(r"([A-Z]{2,})([A-Z][a-z])", r"\1 \2", split)
    plain = "".join(
        c for c in normalize("NFKD", split.lower()) if not combining(c)
    )  # é is e, as in µ and ° nothing changes
    plain = _IDENT.sub(" ", _PER_MILLE.sub("permille", plain))
    plain = re.sub(
        r"\b0x[0-9a-f]+|(?<![0-9a-z])([0-9][0-9a-f]{3}h|[rp][0-9]{2,5}|[tr]pdo[0-9]+)(?![0-9a-z])",
        " ",
        plain,
    )  # an index of the object dictionary, a drive's parameter (`r0078`), a process data object
    words = re.split(r"[^a-zµμ°%‰0-9]+|(?<=[a-z])(?=[0-9])", plain)
    return _merged([part for w in words if w for part in _parts(w)])


def _merged(words: list[str]) -> list[str]:
    """Words in which a current's `i` and the axis `q` of a motor's field are one (`I_q`): behind an
    i stands no joint's position; and so are the parts of a unit of time (`nano sec`).
    """
    out: list[str] = []
    for word in words:
        before = out[-1] if out else ""
        if (before, word) == ("i", "q") or (before in _PARTS and before + word in WORDS["time"]):
            out[-1] += word
        else:
            out.append(word)
    return out


def _parts(word: str) -> tuple[str, ...]:
    """Known words that were written as one (`sollposition`, `measuredtorque`, `jointacttorque`,
    `pcmd`, `tsec`), or the word.
    """
    behind = re.fullmatch(r"(\d+)([a-z]+)", word)  # `q1d`, `theta2ref`
    if behind and behind[2] in _KNOWN | {"d", "r"}:
        return behind[1], behind[2]
    if word not in _KNOWN:
        first, rest = word[:1], word[1:]
        if first in LETTERS and len(rest) >= 3 and rest in COMMAND | ACTUAL | WORDS["error"]:
            return LETTERS[first], rest
        if first == "t" and len(rest) >= 2 and _UNIT_OF.get(rest) in SECONDS:
            return "time", rest
        if joined := _joined(word):
            return joined
        compound = _COMPOUND.fullmatch(word)
        word = compound[1] if compound else word
    return (word,)


def _joined(word: str) -> tuple[str, ...]:
    """The known words that a word consists of, () if it does not: two of them, rather than more."""
    cuts = range(3, len(word) - 2)
    for k in cuts:
        if word[:k] in _KNOWN and word[k:] in _KNOWN:
            return word[:k], word[k:]
        if word[k - 1] == "s" and word[: k - 1] in _KNOWN and word[k:] in _KNOWN:
            return word[: k - 1], word[k:]  # as German joins words
    found = ((word[:k], *_joined(word[k:])) for k in cuts if word[:k] in _KNOWN)
    return next((words for words in found if len(words) > 1), ())


def eastern(text: str) -> bool:
    """Whether a text holds a word of Chinese or Japanese that is known here."""
    return _EAST.search(text) is not None


def unit_of(text: str) -> str:
    """A unit's own name ("deg/s"), or "" if it is none that is known."""
    word = _PER_MILLE.sub("permille", text.strip().lower())
    word = re.sub(r"(?<=[\w%‰])( of\b| rated| nominal).*", "", word)  # % of rated torque
    word = re.sub(r"(?<=[av])[ _]?(rms|eff)$", "", word)  # of a current, and still an ampere
    word = word.replace(" ", "")
    plain = re.sub(r"[·⋅•.*_-]", "", word)  # N·m, oz-in
    return _UNIT_OF.get(word, "") or _UNIT_OF.get(plain, "") or _multiple(word)


def _multiple(word: str) -> str:
    """A number of known units as so many parts of one (`0.1rpm` is `10/rpm`), "" if it is none."""
    found = _TIMES.fullmatch(word)
    many, unit = parts_of(unit_of(found[3])) if found else (0.0, "")
    if found is None or not unit:
        return ""
    number = 10.0 ** int(found[1]) if found[1] else float(found[2].replace(",", "."))
    return f"{1.0 / (many * number):.10g}/{unit}" if number > 0.0 else ""


def parts_of(unit: str) -> tuple[float, str]:
    """How much of another unit one is, and that unit: `10/rpm` are 0.1 rpm, `rpm` is 1."""
    found = _OF_ONE.fullmatch(unit)
    whole = found is not None and float(found[1]) > 0.0
    return (1.0 / float(found[1]), found[2]) if found and whole else (1.0, unit)


def of_joint(header: str, joint: str, headers: Collection[str] = ()) -> Meaning:
    """What a header says of the `joint` that its message names: the name's words tell no quantity,
    and stand in it as a part of a path.
    """
    bare = f"/{header}/".replace(f"/{joint}/", "/", 1).strip("/")
    told = meaning(bare, headers)
    return replace(told, header=header, joint=f"{told.joint} {named(joint)}".strip())


def named(joint: str) -> str:
    """What a joint that its robot calls so is called here."""
    return _joint(tokens(joint), ()) or " ".join(tokens(joint))


def turning(headers: Collection[str]) -> str:
    """Whose drive's properties headers are, of those whose positions are in turns, "" if nobody's:
    two of ODrive's, of which one (or an `axis0`) is nobody else's, or all of moteus', of one motor
    of several, too (`1.position`).
    """
    words = [tokens(h) for h in headers]
    held = ODRIVE & {pair for w in words for pair in pairwise(w)}
    numbered = any(a == "axis" and b.isdigit() for w in words for a, b in pairwise(w))
    if len(held) > 1 and (numbered or not held <= ESTIMATES):
        return "ODrive"
    registers: dict[str, set[str]] = {}
    for group, _, name in (h.lower().rpartition(".") for h in headers):
        registers.setdefault(group, set()).add(name)
    whole = (all(names & word for word in MOTEUS) for names in registers.values())
    return "moteus" if any(whole) else ""


def states(header: str, unit: str) -> bool:
    """Whether a header names this unit, rather than a quantity that usually has it."""
    coded = _object(header)
    named = {unit_of(w) for w in tokens(header)} | {coded.unit if coded else ""}
    return _bracket(header)[1] == unit or unit in named


def _object(header: str) -> Meaning | None:
    """What the index of an object of CiA 402 (`6064h`, `0x6064`, `6064:00`) in a header says."""
    found = next((m for m in _INDEX.finditer(header) if int(m[1], 16) in OBJECTS), None)
    if found is None:
        return None
    index = int(found[1], 16)
    quantity, command, unit = OBJECTS[index]
    bare, stated = _bracket(header[: found.start()] + " " + header[found.end() :])
    words = tokens(bare)
    unit = stated or unit or _unit(words, quantity)
    joint = _joint(words, _quantity(words)[1] | {"internal"}, unit)
    return Meaning(header, quantity, command, joint, unit, AGAIN.get(index, 0))


def _identified(header: str, headers: Collection[str]) -> Meaning | None:
    """What the number of a standard Sercos parameter (`S-0-0051`) in a header says; what stands
    before it is the axis.
    """
    index, axis = _ident(header)
    if index not in IDENTS:
        return None
    quantity, command = IDENTS[index]
    if index == AT_MOTOR and any(_ident(h)[0] == AT_LOAD for h in headers):
        quantity = "motor"
    return Meaning(header, quantity, command, _joint(tokens(axis), ()), _bracket(header)[1])


def _ident(header: str) -> tuple[int, str]:
    """Number of the standard parameter that a header names, -1 if none, and what stands before."""
    found = _IDENT.search(header)
    if found is None or found[0][0] not in "sS":
        return -1, ""
    return int(found[1]), header[: found.start()]


def meaning(header: str, headers: Collection[str] = ()) -> Meaning:
    """What a header says; `headers` are all of its table (`qd` beside `dq` is a command)."""
    of_field = FIELD & {*pairwise(tokens(header))} and any("iq" in tokens(h) for h in headers)
    if of_field:
        return Meaning(header)
    return _identified(header, headers) or _object(header) or _in_words(header, headers)


def _in_words(header: str, headers: Collection[str]) -> Meaning:
    bare, unit = _bracket(header)
    words = tokens(bare)
    held = set(words)
    if "torque" in held and held & WORDS["enable"]:
        return Meaning(header, "enable", joint=_joint(words, WORDS["enable"] | {"torque"}))
    quantity, found = _quantity(_without_run(bare, words))
    calculated = _calculated(quantity, words, headers)
    wanted = _behind(words, COMMAND) or bool(calculated and _behind(words, CALCULATED))
    found = found | calculated | ({"i"} if found & EFFORTS["A"] else set())  # `Motor current I_m`
    if held & VOLTAGES and held & {"motor", "control"} and not (quantity or held & SUPPLY):
        joint = _joint(words, held & VOLTAGES, "V")
        return Meaning(header, "effort", wanted, joint, "V", LOWEST)
    quantity, found, unit = _measured_in(quantity, found, unit, header)
    if quantity == "velocity" and "qd" in held and any("dq" in tokens(h) for h in headers):
        quantity, wanted, found = "position", True, {"qd"}
    if quantity == "position" and {words[0], words[-1]} & CLOCKS:
        quantity, found = "time", {"time"}  # a clock of positions
    if quantity in {"position", "velocity", "effort", ""} and not wanted:
        wanted = _desired(words)
    if quantity in {"position", "velocity"} and held & PLANNED and not held & ACTUAL:
        wanted = wanted or any(_measures(h) for h in headers)
        found = found | (held & PLANNED if wanted else set())
    numbered = {a for a, b in pairwise(words) if a == "id" and b.isdigit()}
    held -= numbered | ({"root"} if held & LIMBS else set())  # of a finger, say
    held -= {"id"} if quantity == "episode" else set()
    if _quantity(leaf := tokens(re.split(r"[/.]", bare)[-1]))[0]:
        held -= GROUPS - set(leaf)
    # ROS's `twist/linear/x` is a body's, as its pose is; `torso_twist` is a joint.
    held |= BODIES if "twist" in held and held & {"linear", "angular"} else set()
    of_point = {"from", "start"} <= held and words[0] != "time"  # when a trajectory is to be there
    clock = quantity == "time" and ("header" in held or held & OTHER <= _BESIDE_TIME)
    if of_point or (held & OTHER and not clock):
        return Meaning(header)
    single = [w for w in words if w in SINGLE]
    if not quantity and single and not wanted and len(words) <= 3:
        quantity, found = SINGLE[single[0]], {single[0]}
        wanted = single[0] == "r"
        unit = unit or _unit(words, quantity)
        joint = _joint(words, found - _directions(headers), unit)
        return Meaning(header, quantity, wanted, joint, unit, LETTER)
    if not quantity and single and wanted and len(words) <= 3 and single[0] in {"x", "y", "z", "v"}:
        quantity, found = SINGLE[single[0]], {single[0]} - _directions(headers)
    if not quantity and held & OUTPUT and not held - OUTPUT - FILLERS - _DRIVEN - _DIGITS:
        unit = unit or ("%" if "%" in held else "")
        return Meaning(header, "effort", False, _joint(words, held & (OUTPUT | {"%"})), unit, 4)
    quantity = quantity or _QUANTITY_OF.get(parts_of(unit)[1], "")
    if not quantity:
        unit = unit or _unit(words, "position")
        quantity = "position" if wanted or held & ACTUAL or _about_position(unit) else "other"
    unit = unit or _unit(words, quantity)
    symbols = _directions(headers) & SYMBOLS
    joint = _joint(words, (found | ({"d", "r"} if wanted else set())) - symbols, unit, symbols)
    rank = _rank(quantity, held, found, wanted)
    return Meaning(header, quantity, wanted, joint, unit, rank)


def _calculated(quantity: str, words: Sequence[str], headers: Collection[str]) -> set[str]:
    """Words that say that an effort was calculated; or a motion, of which a table has the same
    words without them, too: that one was measured.
    """
    held = set(words)
    if quantity == "effort":
        return held & CALCULATED
    computed = held & COMPUTED if quantity in {"position", "velocity"} else set()
    plain = [w for w in words if w not in computed]
    return computed if any(tokens(_bracket(h)[0]) == plain for h in headers) else set()


def _measured_in(
    quantity: str, found: set[str], unit: str, header: str
) -> tuple[str, set[str], str]:
    """Quantity, its words and unit of a header whose unit in brackets fits the quantity or not."""
    if quantity == "position" and "q" not in found and NANO.search(header):
        return quantity, found, NANOMETRES
    if quantity in {"position", "velocity"} and _QUANTITY_OF.get(parts_of(unit)[1]) == "effort":
        return "effort", found | {"i", "q"}, unit  # `I_q [A]`
    if quantity == "effort" and _about_position(unit):
        return quantity, found, ""  # `Current (in)`
    if found & EFFORTS["A"] and {"in", "input"} & set(tokens(header)):
        return "other", found, unit  # what a drive draws, whichever way it turns
    return quantity, found, unit


def _without_run(bare: str, words: list[str]) -> list[str]:
    """The words of a header without those that only say of which run it is (`trial_01/q`)."""
    if "/" not in bare:
        return words
    leaf = set(tokens(bare.rpartition("/")[2]))
    return [w for w in words if w not in WORDS["episode"] or w in leaf]


def same_joint(a: str, b: str) -> bool:
    """Whether two names are of one joint, as the robot calls it (`fr3_joint1`) and as its columns
    are told apart (`fr 3 1`).
    """
    one, other = ([w for w in tokens(name) if w not in FILLERS] for name in (a, b))
    return one == other if one and other else tokens(a) == tokens(b)


def names_a_joint(header: str) -> bool:
    """Whether a header says that it is a joint's: by a limb, or a joint's number."""
    return bool(set(tokens(header)) & (LIMBS | JOINTS))


def said_actual(header: str) -> tuple[str, ...]:
    """The words of a header that says that it was measured without those that say so; () if it
    does not, or is a command's.
    """
    words = tokens(header)
    plain = tuple(w for w in words if w not in MEASURED)
    return plain if len(plain) < len(words) and not COMMAND & set(words) else ()


def _measures(header: str) -> bool:
    """Whether a header names a measured position."""
    held = set(tokens(header))
    return bool(held & WORDS["position"]) and bool(held & ACTUAL) and not held & COMMAND


def _directions(headers: Collection[str]) -> frozenset[str]:
    """Letters and angles that tell the joints of a table apart: x beside y, theta beside phi or x,
    where headers say no more than these (`theta_ref [rad]`).
    """
    letters, angles = _symbols(tuple(headers))
    return letters | angles if len(letters | angles) > 1 else frozenset()


@lru_cache(maxsize=8)
def _symbols(headers: tuple[str, ...]) -> tuple[frozenset[str], frozenset[str]]:
    """Letters of a table's headers, and angles that stand alone in some of them."""
    words = [tokens(h) for h in headers]
    letters = DIRECTIONS & {w for held in words for w in held}
    left = [[w for w in held if w not in _BESIDE_SYMBOL] for held in words]
    alone = {held[0] for held in left if len(held) == 1}
    angles = SYMBOLS & alone
    return (letters & alone if angles else letters), angles


MOTOR = _set("motor motors mot antrieb rotor")
_BEHIND = MOTOR | PLANNED | _set("raw encoder enc")
"""Words of positions that are of the motor, or otherwise not the joint's own."""
TOLD = ("position", "velocity", "effort", "acceleration")
"""Quantities that the name of a file may tell."""


def stem_says(stem: str) -> tuple[str, bool]:
    """Quantity ("" if none) and whether commanded, from a file's or a topic's name."""
    words = tokens(stem)
    quantity, _ = _quantity(words)
    wanted = bool(set(words) & COMMAND) and not set(words) & ACTUAL
    return quantity if quantity in TOLD else "", wanted


def stem_rank(stem: str) -> int:
    """The rank of the efforts that a file's name says: torque before current."""
    quantity, found = _quantity(tokens(stem))
    return _rank(quantity, set(tokens(stem)), found)


def stem_unit(stem: str) -> str:
    """The unit of the efforts that a file's name says (`torques`: Nm), or ""."""
    return _unit(tokens(stem), "effort")


def stem_joint(stem: str) -> str:
    """The number of the joint that a file's name says (`joint2`, `motor_3_run`), or ""."""
    words = tokens(stem)
    pairs = pairwise(words)
    return next((str(int(b)) for a, b in pairs if a in JOINTS and b.isdigit()), "")


def stem_key(stem: str) -> tuple[str, ...]:
    """What is left of a file's name without words for quantity and role: equal for the files of one
    recording.
    """
    noise = COMMAND | ACTUAL | FILLERS | (OTHER - BODIES) | WORDS["position"] | WORDS["velocity"]
    noise |= WORDS["effort"] | WORDS["acceleration"] | WORDS["time"] | {"read", "record", "records"}
    return tuple(w for w in tokens(stem) if w not in noise)


def with_context(found: Meaning, quantity: str, command: bool) -> Meaning:
    """A meaning with what the file's name adds where the header is silent."""
    if found.quantity == "other" and (quantity or command) and silent(found.header):
        joint = " ".join(w for w in tokens(found.header) if w.isdigit())
        return replace(found, quantity=quantity or "position", command=command, joint=joint)
    if found.quantity in {"other", "time"}:
        return found
    if quantity and not found.command and found.rank >= BARE:
        found = replace(found, quantity=quantity)
    return replace(found, command=found.command or command)


def silent(header: str) -> bool:
    """Whether a header is nothing but an index and words like "data"."""
    return all(w.isdigit() or w in FILLERS for w in tokens(header))


def _bracket(header: str) -> tuple[str, str]:
    """Header without a unit in brackets or behind a slash of one, and that unit."""
    for m in re.finditer(r"[\[\(\{<]([^\]\)\}>]*)[\]\)\}>]", header):
        if unit := unit_of(m[1]):
            return header[: m.start()] + " " + header[m.end() :], unit
    tail = re.search(
        r"[_ ](rad/s|deg/s|rad_s|deg_s|rad_per_s|deg_per_s|mm_s|m_s|rad/sec)(\[\d+\])?$", header
    )
    if tail:
        return header[: tail.start()] + (tail[2] or ""), unit_of(
            tail[1].replace("_per_", "/").replace("_s", "/s").replace("sec", "s")
        )
    return header, ""


def _quantity(words: Sequence[str]) -> tuple[str, set[str]]:
    held = set(words)
    if held & WORDS["error"] and not held & (WORDS["velocity"] | WORDS["effort"]):
        return "error", held & (WORDS["error"] | WORDS["position"])
    for name in ("acceleration", "velocity", "effort", "position", "episode", "enable", "time"):
        match = held & WORDS[name]
        if name == "velocity":
            match -= {"rate"} if len(match) == 1 and held & WORDS["time"] else set()
        if name == "episode" and held & WITHIN:
            continue
        if name == "effort" and _adjective(words, match) and held & WORDS["position"]:
            continue
        dots = words.count("dot") if held & WORDS["position"] else 0
        if not match and dots and name == ("velocity" if dots == 1 else "acceleration"):
            match = {"dot"}
        if name == "effort" and not match and held & {"nm", "mnm"}:
            match = held & {"nm", "mnm"}
        if match:
            if name == "time" and held & COMMAND and not held & {"time", "timestamp", "stamp"}:
                continue
            return name, match
    return "", set()


def _adjective(words: Sequence[str], match: set[str]) -> bool:
    """Whether the words of an effort only say which position: `load_angle`, `current_position`,
    `q_curr`.
    """
    places = [k for k, w in enumerate(words) if w in WORDS["position"]]
    before = any(a == "current" and b in WORDS["position"] - {"q"} for a, b in pairwise(words))
    ahead = bool(places) and (before or words[0] == "current")
    ahead = ahead and not {"a", "ma", "amp"} & set(words)
    return match <= {"load", "loads", "curr"} or (match == {"current"} and ahead)


def _behind(words: Sequence[str], said_by: Collection[str]) -> bool:
    """Whether a word says so, and none behind it says "measured" (`current_control.measured`)."""
    said = [w for w in words if w not in FILLERS or w in STATES]  # `desired_joint_state`
    wanted_state = {b for a, b in pairwise(said) if a in COMMAND and b in STATES}
    last = {w: k for k, w in enumerate(words) if w not in wanted_state}
    first = max((last[w] for w in last if w in said_by), default=-1)
    return first > max((last[w] for w in last if w in ACTUAL), default=-1)


def _desired(words: Sequence[str]) -> bool:
    """`q_d`, `dq_d`, `theta_r`, `tau_J_d`: a lone d or r behind the quantity; `q_r_hip` and `vel_r`
    are right.
    """
    said = WORDS["position"] | WORDS["effort"] | DIRECTIONS
    rates = WORDS["velocity"] | WORDS["acceleration"]
    return any(
        (w in {"d", "star"} and any(k in said | rates for k in words[:n]))
        or (w == "r" and not LIMBS & set(words[n + 1 : n + 2]) and said & set(words[:n]))
        for n, w in enumerate(words)
    ) or any(w in {"qref", "qdes", "qcmd", "posdes", "posref", "xd", "xdes"} for w in words)


def _unit(words: Sequence[str], quantity: str) -> str:
    allowed = _IN_NAMES.get("position" if quantity == "error" else quantity, frozenset())
    if ANGLES & set(words):  # `theta_m` is measured
        allowed -= {"m"}
    for w in reversed(words):
        if w in allowed and not (w in {"m", "a", "n", "s"} and w != words[-1]):
            return unit_of(w)
    if quantity == "effort":
        return next((unit for unit, names in EFFORTS.items() if set(words) & names), "")
    return ""


def _about_position(unit: str) -> bool:
    return parts_of(unit)[1] in {"rad", "deg", "turn", "m", "mm", "cm"}


def _joint(
    words: Sequence[str], found: Collection[str], unit: str = "", kept: Collection[str] = ()
) -> str:
    """What is left of words: the joint's name, of which `kept` are a part whatever they mean."""
    units = {w for w, u in _UNIT_OF.items() if u == unit} if unit else set()
    skip = COMMAND | ACTUAL | FILLERS | set(found) | units | {"id"}
    skip |= GROUPS | WORDS["position"] | WORDS["velocity"] | WORDS["effort"] | WORDS["error"]
    skip -= {"index"} if {"finger", "fingers"} & set(words) else set()
    own = (w for w in words if w not in skip or w in kept)
    return " ".join(str(int(w)) if w.isdigit() else w for w in own)


def _rank(quantity: str, held: set[str], found: set[str], wanted: bool = False) -> int:
    """Torque before current before load before duty; joint before motor side; filtered last; an
    observation before its copy beside an action.
    """
    rank = 0
    if quantity == "effort":
        order = (
            EFFORTS["Nm"] | EFFORTS["N"] | {"effort", "efforts"},
            EFFORTS["A"],
            {"load", "loads"},
            {"pwm", "duty"},
        )
        rank = next((k for k, names in enumerate(order) if found & names), 4)
    if quantity == "time":
        rank = 0 if held & {"time", "timestamp", "stamp", "elapsed", "t"} else 1
        rank += 2 if held & {"ext", "external", "log", "publish", "received", "duration"} else 0
    if quantity == "position" and not found:
        rank = BARE  # nothing but "actual" or a unit says so
    if quantity == "position" and held & _BEHIND:
        rank += 1
    if quantity in {"position", "velocity"} and found and held & COMMAND and not wanted:
        rank += 1
    return rank
