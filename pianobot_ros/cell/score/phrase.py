"""Phrase files (``docs/phrases.md``): strikes written out by hand, with exact speeds, depths and
holds.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from pianobot_ros.cell.errors import ConfigError, ScoreError, unknown_name
from pianobot_ros.cell.motion.geometry import FINGERS, is_black, keyboard
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.numbers.bounded_files import parse_yaml, read_bytes, title
from pianobot_ros.cell.numbers.config import Section, checked, first_problem
from pianobot_ros.cell.score.types import (
    Score,
    ScoreStrike,
    check_strikes,
    check_tempo,
    hold_for,
    motion_refusal,
)

__all__ = ["Phrase", "parse_phrase", "read_phrase"]

ARTICULATION = {"staccato": 0.3, "tenuto": 0.6, "legato": 0.85}
"""Share of the note length during which the key is held (T_hold / T_N)."""


Note = Annotated[int, Field(ge=0, le=127)]
Name = Annotated[str, Field(max_length=200)]
SLOWEST = 0.001  # m/s: a strike then takes half a minute


class Glissando(Section):
    """A slide over the white keys from one note to another; ``time`` in s from first to last."""

    start: Note = Field(alias="from")
    to: Note
    time: float = Field(ge=0.1, le=20)


class Defaults(Section):
    """What a line of a phrase may give; what it does not give comes from the phrase's ``defaults``,
    else from here.
    """

    note: Note | None = None
    notes: dict[str, Note] | list[Note] | None = None
    glissando: Glissando | None = None
    finger: Name = "middle"
    speed: float = Field(0.15, ge=SLOWEST, le=2)
    depth: float = Field(0.014, ge=0.001, le=0.03)
    hold: float = Field(0.2, ge=0, le=20)
    clearance: float = Field(0.005, ge=0.002, le=0.05)
    release_speed: float = Field(0.0, ge=0, le=2)
    pressure: float = Field(-50e3, ge=-100e3, le=0)
    note_length: float = Field(0.0, ge=0, le=60)
    articulation: Literal["staccato", "tenuto", "legato"] | None = None
    condition: Name = ""
    repeats: int = Field(1, ge=1, le=1000)


class PhraseEntry(Defaults):
    """One line of a phrase with what comes from its defaults."""

    @model_validator(mode="after")
    def _one_target(self) -> PhraseEntry:
        if sum(x is not None for x in (self.note, self.notes, self.glissando)) != 1:
            raise ValueError("give exactly one of note, notes and glissando")
        if self.articulation and not self.note_length:
            raise ValueError("articulation needs a note_length")
        if 0 < self.release_speed < SLOWEST:
            raise ValueError(f"release_speed must be 0, for as speed, or at least {SLOWEST:g}")
        if self.articulation and "hold" in self.model_fields_set:
            raise ValueError("give hold or articulation, not both")
        return self


class Phrase(Section):
    """A phrase file."""

    name: Name = ""
    description: str = ""
    order: Literal["as_written", "rounds", "shuffled"] = "as_written"
    seed: int = Field(0, ge=0, le=2**53)
    defaults: dict[str, Any] = Field(default_factory=dict)
    strikes: list[dict[str, Any]]


def read_phrase(path: str | Path, *, transpose: int = 0, tempo: float = 1.0) -> Score:
    """The phrase in a file. Raises :class:`ScoreError` that names file, strike and field."""
    path = Path(path)
    try:
        data = parse_yaml(read_bytes(path), str(path))
    except ConfigError as error:
        raise ScoreError(str(error)) from error
    return _phrase(data, title(path), path.name, transpose, tempo)


def parse_phrase(text: str, *, transpose: int = 0, tempo: float = 1.0) -> Score:
    """The phrase in a YAML text."""
    try:
        data = parse_yaml(text, "the phrase")
    except ConfigError as error:
        raise ScoreError(str(error)) from error
    return _phrase(data, "inline", "phrase", transpose, tempo)


def _phrase(data: dict[str, Any], stem: str, where: str, transpose: int, tempo: float) -> Score:
    check_tempo(tempo)
    phrase = _validated(Phrase, data, where)
    _validated(Defaults, phrase.defaults, f"{where}: defaults")
    if not phrase.strikes:
        raise ScoreError(f"{where}: there are no strikes")
    groups: list[list[ScoreStrike]] = []
    count = 0
    for i, raw in enumerate(phrase.strikes, 1):
        at = f"{where}: strike {i}"
        defaults = dict(phrase.defaults)
        # A line's own way of saying how long the key is held takes the place of the default's.
        for one, other in (("hold", "articulation"), ("articulation", "hold")):
            if one in raw and other not in raw:
                defaults.pop(other, None)
        for target in ("note", "notes", "glissando"):
            if target in raw:
                defaults = {
                    k: v for k, v in defaults.items() if k not in ("note", "notes", "glissando")
                }
        entry = _validated(PhraseEntry, {**defaults, **raw}, at)
        count += entry.repeats
        check_strikes(count, at)
        groups.append(_strikes(entry, at, transpose, tempo))
    return Score(phrase.name or stem, tuple(_ordered(groups, phrase)))


def _ordered(groups: list[list[ScoreStrike]], phrase: Phrase) -> list[ScoreStrike]:
    """``rounds``: all conditions once, then again; ``shuffled``: likewise, in orders drawn by the
    seed.

    From four rounds on, two orders take turns: each condition then has repeats after the same
    strike, whose differences are scatter, and after another one, whose differences are not.
    """
    if phrase.order == "as_written":
        return [strike for group in groups for strike in group]
    draw = random.Random(phrase.seed)
    rounds = max(len(group) for group in groups)
    places = list(range(len(groups)))
    orders = [
        draw.sample(places, len(places)) if phrase.order == "shuffled" else places
        for _ in range(2 if rounds > 3 else rounds)
    ]
    strikes = []
    for i in range(rounds):
        strikes += [groups[k][i] for k in orders[i % len(orders)] if i < len(groups[k])]
    return strikes


def _strikes(entry: PhraseEntry, at: str, transpose: int, tempo: float) -> list[ScoreStrike]:
    try:
        targets = _targets(entry)
    except ValueError as error:
        raise ScoreError(f"{at}: {error}") from error
    targets = {finger: note + transpose for finger, note in targets.items()}
    slide: tuple[int, ...] = ()
    if entry.glissando:
        first, last = entry.glissando.start + transpose, entry.glissando.to + transpose
        step = 1 if last >= first else -1
        slide = tuple(n for n in range(first, last + step, step) if not is_black(n))
        if len(slide) < 2 or is_black(first) or is_black(last):
            raise ScoreError(
                f"{at}: a glissando goes from one white key to another, not from {first} to {last}"
            )
    note_length = entry.note_length / tempo
    motion = StrikeMotion(
        entry.speed, entry.depth, entry.hold, entry.clearance, entry.release_speed
    )
    note = next(iter(targets.values()))
    _check(targets, slide, motion, at)
    if entry.articulation:
        hold = hold_for(motion, note, ARTICULATION[entry.articulation] * note_length)
        motion = StrikeMotion(entry.speed, entry.depth, hold, entry.clearance, entry.release_speed)
    condition = entry.condition or _condition(targets, motion, entry, slide)
    strike = ScoreStrike(
        fingers=tuple(targets),
        notes=tuple(targets.values()),
        motion=motion,
        pressure=entry.pressure,
        condition=condition,
        note_length=note_length,
        slide=slide,
        slide_time=entry.glissando.time / tempo if entry.glissando else 0.0,
    )
    return [strike] * entry.repeats


def _targets(entry: PhraseEntry) -> dict[str, int]:
    if entry.finger not in FINGERS:
        raise ValueError(unknown_name("finger", entry.finger, FINGERS))
    if entry.note is not None:
        return {entry.finger: entry.note}
    if entry.glissando is not None:
        return {entry.finger: entry.glissando.start}
    notes = entry.notes
    if isinstance(notes, list):
        if len(notes) != 2:
            raise ValueError(
                f"notes must name two notes (thumb below, middle above), not {len(notes)}"
            )
        return {"thumb": min(notes), "middle": max(notes)}
    assert notes is not None
    if not 1 <= len(notes) <= 2:
        raise ValueError(f"the hand strikes with one or two fingers, not {len(notes)}")
    for finger in notes:
        if finger not in FINGERS:
            raise ValueError(unknown_name("finger", finger, FINGERS))
    return dict(notes)


def _check(targets: dict[str, int], slide: tuple[int, ...], motion: StrikeMotion, at: str) -> None:
    board, limits = keyboard(), wrist_limits()
    for note in (*targets.values(), *slide):
        if note not in board.notes:
            raise ScoreError(
                f"{at}: note {note} is not on the keyboard ({board.notes[0]} to {board.notes[-1]}):"
                " change it or give --transpose"
            )
    try:
        pose = wrist_pose(targets)
    except ScoreError as error:
        raise ScoreError(f"{at}: {error}") from error
    if reason := motion_refusal(motion, limits) or limits.refusal(pose.raised(-motion.depth)):
        raise ScoreError(f"{at}: {reason}")


def _condition(
    targets: dict[str, int], motion: StrikeMotion, entry: PhraseEntry, slide: tuple[int, ...]
) -> str:
    """A name that like strikes share."""
    keys = "+".join(f"{finger[0]}{note}" for finger, note in targets.items()) + (
        f"-{slide[-1]}" if slide else ""
    )
    return (
        f"{keys} {motion.speed:g}m/s {1e3 * motion.depth:g}mm {1e3 * motion.hold:.0f}ms"
        f" {entry.pressure / 1e3:g}kPa"
    )


def _known(data: dict[str, Any], model: type[Section], at: str) -> None:
    names = [f.alias or name for name, f in model.model_fields.items()]
    for name in data:
        if name not in names:
            raise ScoreError(f"{at}: " + unknown_name("name", str(name), names))


def _validated(model: Any, data: Any, at: str) -> Any:
    if not isinstance(data, dict):
        raise ScoreError(f"{at}: must be a mapping of names to values (docs/phrases.md)")
    _known(data, model, at)
    try:
        return checked(model, data)
    except ValidationError as error:
        raise ScoreError(f"{at}: {first_problem(error)}") from error
