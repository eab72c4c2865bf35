"""What a header says: quantity, commanded or measured, joint and unit."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

from pianobot_ros.axis.reading.headers.coded import cia402_object, sercos_datum
from pianobot_ros.axis.reading.headers.phrases import (
    by_unit,
    joint_letters,
    joint_said,
    measures_position,
    quantity_said,
    rank_of,
    said_last,
    says_desired,
    silent,
    split_unit,
    unit_said,
    without_run,
    words_of_calculation,
)
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.unit_words import (
    QUANTITY_OF,
    about_position,
    parts_of,
    unit_of,
)
from pianobot_ros.axis.reading.headers.vocabulary import (
    ACTUAL,
    BARE,
    BODIES,
    CALCULATED,
    CLOCKS,
    COMMAND,
    EFFORTS,
    ESTIMATES,
    FIELD,
    FILLERS,
    GROUPS,
    LETTER,
    LIMBS,
    LOWEST,
    MOTEUS,
    ODRIVE,
    OTHER,
    OUTPUT,
    PLANNED,
    SINGLE,
    SUPPLY,
    SYMBOLS,
    VOLTAGES,
    WORDS,
    words_of,
)
from pianobot_ros.axis.reading.headers.words import tokens

_BESIDE_TIME = words_of("ext external id type")
_DRIVEN = words_of("control controller ctrl pid % percent")
_DIGITS = frozenset(map(str, range(64)))


def of_joint(header: str, joint: str, headers: Collection[str] = ()) -> Meaning:
    """What a header says of the `joint` that its message names: the name's words tell no quantity,
    and stand in it as a part of a path.
    """
    bare = f"/{header}/".replace(f"/{joint}/", "/", 1).strip("/")
    told = meaning(bare, headers)
    return replace(told, header=header, joint=f"{told.joint} {named(joint)}".strip())


def named(joint: str) -> str:
    """What a joint that its robot calls so is called here."""
    return joint_said(tokens(joint), ()) or " ".join(tokens(joint))


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
    coded = cia402_object(header)
    named = {unit_of(w) for w in tokens(header)} | {coded.unit if coded else ""}
    return split_unit(header)[1] == unit or unit in named


def meaning(header: str, headers: Collection[str] = ()) -> Meaning:
    """What a header says; `headers` are all of its table (`qd` beside `dq` is a command)."""
    of_field = FIELD & {*pairwise(tokens(header))} and any("iq" in tokens(h) for h in headers)
    if of_field:
        return Meaning(header)
    return sercos_datum(header, headers) or cia402_object(header) or _in_words(header, headers)


def _in_words(header: str, headers: Collection[str]) -> Meaning:
    bare, unit = split_unit(header)
    words = tokens(bare)
    held = set(words)
    if "torque" in held and held & WORDS["enable"]:
        return Meaning(header, "enable", joint=joint_said(words, WORDS["enable"] | {"torque"}))
    quantity, found = quantity_said(without_run(bare, words))
    calculated = words_of_calculation(quantity, words, headers)
    wanted = said_last(words, COMMAND) or bool(calculated and said_last(words, CALCULATED))
    found = found | calculated | ({"i"} if found & EFFORTS["A"] else set())  # `Motor current I_m`
    if held & VOLTAGES and held & {"motor", "control"} and not (quantity or held & SUPPLY):
        joint = joint_said(words, held & VOLTAGES, "V")
        return Meaning(header, "effort", wanted, joint, "V", LOWEST)
    quantity, found, unit = by_unit(quantity, found, unit, header)
    if quantity == "velocity" and "qd" in held and any("dq" in tokens(h) for h in headers):
        quantity, wanted, found = "position", True, {"qd"}
    if quantity == "position" and {words[0], words[-1]} & CLOCKS:
        quantity, found = "time", {"time"}  # a clock of positions
    if quantity in {"position", "velocity", "effort", ""} and not wanted:
        wanted = says_desired(words)
    if quantity in {"position", "velocity"} and held & PLANNED and not held & ACTUAL:
        wanted = wanted or any(measures_position(h) for h in headers)
        found = found | (held & PLANNED if wanted else set())
    numbered = {a for a, b in pairwise(words) if a == "id" and b.isdigit()}
    held -= numbered | ({"root"} if held & LIMBS else set())  # of a finger, say
    held -= {"id"} if quantity == "episode" else set()
    if quantity_said(leaf := tokens(re.split(r"[/.]", bare)[-1]))[0]:
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
        unit = unit or unit_said(words, quantity)
        joint = joint_said(words, found - joint_letters(headers), unit)
        return Meaning(header, quantity, wanted, joint, unit, LETTER)
    if not quantity and single and wanted and len(words) <= 3 and single[0] in {"x", "y", "z", "v"}:
        quantity, found = SINGLE[single[0]], {single[0]} - joint_letters(headers)
    if not quantity and held & OUTPUT and not held - OUTPUT - FILLERS - _DRIVEN - _DIGITS:
        unit = unit or ("%" if "%" in held else "")
        return Meaning(header, "effort", False, joint_said(words, held & (OUTPUT | {"%"})), unit, 4)
    quantity = quantity or QUANTITY_OF.get(parts_of(unit)[1], "")
    if not quantity:
        unit = unit or unit_said(words, "position")
        quantity = "position" if wanted or held & ACTUAL or about_position(unit) else "other"
    unit = unit or unit_said(words, quantity)
    symbols = joint_letters(headers) & SYMBOLS
    joint = joint_said(words, (found | ({"d", "r"} if wanted else set())) - symbols, unit, symbols)
    rank = rank_of(quantity, held, found, wanted)
    return Meaning(header, quantity, wanted, joint, unit, rank)


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
