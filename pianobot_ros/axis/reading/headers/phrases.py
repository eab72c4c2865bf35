"""What the words of a header say together: quantity, commanded or not, joint, unit, rank."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from functools import lru_cache
from itertools import pairwise

from pianobot_ros.axis.reading.headers.unit_words import (
    NANO,
    NANOMETRES,
    QUANTITY_OF,
    UNIT_OF,
    UNITS_IN_NAMES,
    about_position,
    parts_of,
    unit_of,
)
from pianobot_ros.axis.reading.headers.vocabulary import (
    ACTUAL,
    ANGLES,
    BARE,
    CALCULATED,
    COMMAND,
    COMPUTED,
    DIRECTIONS,
    EFFORTS,
    FILLERS,
    GROUPS,
    JOINTS,
    LIMBS,
    MEASURED,
    MOTOR,
    PLANNED,
    STATES,
    SYMBOLS,
    WITHIN,
    WORDS,
    words_of,
)
from pianobot_ros.axis.reading.headers.words import tokens

_BESIDE_SYMBOL = COMMAND | ACTUAL | FILLERS | (WORDS["position"] - SYMBOLS) | set(UNIT_OF)
_BEHIND = MOTOR | PLANNED | words_of("raw encoder enc")
"""Words of positions that are of the motor, or otherwise not the joint's own."""


def words_of_calculation(quantity: str, words: Sequence[str], headers: Collection[str]) -> set[str]:
    """Words that say that an effort was calculated; or a motion, of which a table has the same
    words without them, too: that one was measured.
    """
    held = set(words)
    if quantity == "effort":
        return held & CALCULATED
    computed = held & COMPUTED if quantity in {"position", "velocity"} else set()
    plain = [w for w in words if w not in computed]
    return computed if any(tokens(split_unit(h)[0]) == plain for h in headers) else set()


def by_unit(quantity: str, found: set[str], unit: str, header: str) -> tuple[str, set[str], str]:
    """Quantity, its words and unit of a header whose unit in brackets fits the quantity or not."""
    if quantity == "position" and "q" not in found and NANO.search(header):
        return quantity, found, NANOMETRES
    if quantity in {"position", "velocity"} and QUANTITY_OF.get(parts_of(unit)[1]) == "effort":
        return "effort", found | {"i", "q"}, unit  # `I_q [A]`
    if quantity == "effort" and about_position(unit):
        return quantity, found, ""  # `Current (in)`
    if found & EFFORTS["A"] and {"in", "input"} & set(tokens(header)):
        return "other", found, unit  # what a drive draws, whichever way it turns
    return quantity, found, unit


def without_run(bare: str, words: list[str]) -> list[str]:
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


def measures_position(header: str) -> bool:
    """Whether a header names a measured position."""
    held = set(tokens(header))
    return bool(held & WORDS["position"]) and bool(held & ACTUAL) and not held & COMMAND


def joint_letters(headers: Collection[str]) -> frozenset[str]:
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


def silent(header: str) -> bool:
    """Whether a header is nothing but an index and words like "data"."""
    return all(w.isdigit() or w in FILLERS for w in tokens(header))


def split_unit(header: str) -> tuple[str, str]:
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


def quantity_said(words: Sequence[str]) -> tuple[str, set[str]]:
    """The quantity that words say ("" if none), and which of them say it."""
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


def said_last(words: Sequence[str], said_by: Collection[str]) -> bool:
    """Whether a word says so, and none behind it says "measured" (`current_control.measured`)."""
    said = [w for w in words if w not in FILLERS or w in STATES]  # `desired_joint_state`
    wanted_state = {b for a, b in pairwise(said) if a in COMMAND and b in STATES}
    last = {w: k for k, w in enumerate(words) if w not in wanted_state}
    first = max((last[w] for w in last if w in said_by), default=-1)
    return first > max((last[w] for w in last if w in ACTUAL), default=-1)


def says_desired(words: Sequence[str]) -> bool:
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


def unit_said(words: Sequence[str], quantity: str) -> str:
    """The unit that words of a quantity say, or ""."""
    allowed = UNITS_IN_NAMES.get("position" if quantity == "error" else quantity, frozenset())
    if ANGLES & set(words):  # `theta_m` is measured
        allowed -= {"m"}
    for w in reversed(words):
        if w in allowed and not (w in {"m", "a", "n", "s"} and w != words[-1]):
            return unit_of(w)
    if quantity == "effort":
        return next((unit for unit, names in EFFORTS.items() if set(words) & names), "")
    return ""


def joint_said(
    words: Sequence[str], found: Collection[str], unit: str = "", kept: Collection[str] = ()
) -> str:
    """What is left of words: the joint's name, of which `kept` are a part whatever they mean."""
    units = {w for w, u in UNIT_OF.items() if u == unit} if unit else set()
    skip = COMMAND | ACTUAL | FILLERS | set(found) | units | {"id"}
    skip |= GROUPS | WORDS["position"] | WORDS["velocity"] | WORDS["effort"] | WORDS["error"]
    skip -= {"index"} if {"finger", "fingers"} & set(words) else set()
    own = (w for w in words if w not in skip or w in kept)
    return " ".join(str(int(w)) if w.isdigit() else w for w in own)


def rank_of(quantity: str, held: set[str], found: set[str], wanted: bool = False) -> int:
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
