"""Units as they are written, and what they tell of a quantity."""

from __future__ import annotations

import re

from pianobot_ros.axis.reading.headers.vocabulary import words_of

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
UNIT_OF = {word: unit for unit, words in UNITS.items() for word in words.split()}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in a unit of time."""
QUANTITY_OF = {
    **dict.fromkeys(
        ("rad/s", "deg/s", "rpm", "turn/s", "m/s", "mm/s", "m/min", "mm/min"), "velocity"
    ),
    **dict.fromkeys(("Nm", "mNm", "cNm", "kNm", "uNm", "N", "kN", "A", "mA"), "effort"),
}
UNITS_IN_NAMES = {
    "position": words_of(
        "deg degree degrees grad rad radian radians turn turns rev mm cm um m counts ticks tick"
        " pulse pulses mrad urad mdeg cdeg millideg arcmin arcsec inch inches"
    ),
    "velocity": words_of("rpm erpm rads degs dps radps mps mmps"),
    "effort": words_of(
        "nm mnm cnm ncm nmm n kn a ma percent pct amp amps ‰ permille permil promille"
    ),
    "time": words_of(
        "s ms us ns sec secs second seconds msec msecs millis usec usecs micros nsec nsecs nanosec"
        " milliseconds microseconds nanoseconds millisecond microsecond nanosecond"
    ),
}
_TIMES = re.compile(r"[x×]?(?:10\^(-?\d+)|(\d*[.,]?\d+(?:e[-+]?\d+)?))[*x×·]?([^\d.,\s].*)")
"""A number of units: `0.1rpm`, `10^-4deg`."""
_OF_ONE = re.compile(r"(\d+(?:\.\d*)?(?:e[-+]?\d+)?)\s*/\s*(\S+)")
PER_MILLE = re.compile(r"(?<![a-z])per[ _-]?mill?e?(?![a-z])")


def unit_of(text: str) -> str:
    """A unit's own name ("deg/s"), or "" if it is none that is known."""
    word = PER_MILLE.sub("permille", text.strip().lower())
    word = re.sub(r"(?<=[\w%‰])( of\b| rated| nominal).*", "", word)  # % of rated torque
    word = re.sub(r"(?<=[av])[ _]?(rms|eff)$", "", word)  # of a current, and still an ampere
    word = word.replace(" ", "")
    plain = re.sub(r"[·⋅•.*_-]", "", word)  # N·m, oz-in
    return UNIT_OF.get(word, "") or UNIT_OF.get(plain, "") or _multiple(word)


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


def about_position(unit: str) -> bool:
    """Whether a unit is a position's."""
    return parts_of(unit)[1] in {"rad", "deg", "turn", "m", "mm", "cm"}
