"""Measures how strong each effect must be to open a gap of 1, 3 and 10 repeatability floors.

``python -m pianobot_ros.emulator.plant.calibrate [--write] [--missing] [--effects a,b_law1]`` plays
the standard strikes without noise with the effect at several strengths, compares with the nominal
cell and interpolates. The gap is the largest, over the signals of the cell, of the RMS difference
in units of that signal's floor; the floor is the RMS difference of two nominal cells that differ in
nothing but their random numbers, divided by the root of two.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.config import config_file
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.cases.effects import (
    EFFECTS,
    LEVELS,
    parse_effects,
    size_name,
    split_law,
)
from pianobot_ros.emulator.plant.laws.table import law_count
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes

__all__ = ["floors", "gaps", "observables"]


POINTS = 9
FEATURES = ("onset", "hold", "velocity_on", "velocity_off")
_COMMAND = "python -m pianobot_ros.emulator.plant.calibrate --write"
_BY_CHOICE = {"stuck_contact": (0.05, 0.15, 0.5)}
"""Rare events have no RMS to scale: their probability is chosen."""


def observables(recording: Recording) -> dict[str, Array]:
    """What is compared: signals over the strikes on the host's time axis, and keystroke features,
    one row per strike.
    """
    grid = np.concatenate([np.arange(s.start, s.end, 1e-3) for s in recording.strikes])
    found = {}
    for name, column in (
        ("wrist/state.position", 2),
        ("vacuum/state.measured", 2),
        ("fsr.force", None),
    ):
        signal = recording.signal(f"real/{name}")
        found[name] = np.interp(
            grid, signal.time, signal.value if column is None else signal.value[:, column]
        )
    angle = recording.signal(f"real/key_angle.{recording.fsr_note}")
    found["key_angle"] = np.interp(grid, angle.time, angle.value)
    rows = np.full((len(recording.strikes), 4), np.nan)
    for i, strike in enumerate(recording.strikes):
        notes = [n for n in recording.notes["real"] if strike.start <= n.time <= strike.end + 0.1]
        on = next((n for n in notes if n.on), None)
        off = next((n for n in notes if not n.on), None)
        if on is not None and off is not None:
            rows[i] = on.time - strike.start, off.time - on.time, on.velocity, off.velocity
    for k, name in enumerate(FEATURES):
        found[name] = rows[:, k]
    return found


def floors(commands: Commands, seeds: tuple[int, ...] = (101, 102, 103, 104)) -> dict[str, float]:
    """Repeatability floor of every observable, in its own unit."""
    cells = [observables(simulate_commands(commands, Case(seed=seed))) for seed in seeds]
    return {
        name: float(
            np.sqrt(
                np.nanmean(
                    [(a[name] - b[name]) ** 2 for a, b in zip(cells[::2], cells[1::2], strict=True)]
                )
                / 2
            )
        )
        for name in cells[0]
    }


def gaps(
    real: Mapping[str, Array], nominal: Mapping[str, Array], floor: Mapping[str, float]
) -> dict[str, float]:
    """RMS difference by observable in units of its floor.

    Of the keystroke features the most different tenth of the strikes is left out: a release that
    happens to bounce at the trigger would otherwise speak for all.
    """
    found = {}
    for name in floor:
        squares = np.sort((real[name] - nominal[name]) ** 2)
        squares = squares[np.isfinite(squares)]
        if name in FEATURES:
            squares = squares[: len(squares) - len(squares) // 10]
        found[name] = float(np.sqrt(np.mean(squares)) / floor[name]) if len(squares) else 0.0
    return found


def _strengths(
    name: str, commands: Commands, nominal: Mapping[str, Array], floor: Mapping[str, float]
) -> list[float]:
    """Physical parameter of an effect (with its law) at the three levels."""
    if name in _BY_CHOICE:
        return list(_BY_CHOICE[name])
    effect = EFFECTS[split_law(name)[0]]
    values = np.geomspace(effect.low, effect.high, POINTS)
    sizes = []
    for value in values:
        case = Case(physical={name: float(value)}, repeatability=0.0, noise=0.0)
        gap = gaps(observables(simulate_commands(commands, case, rounded=False)), nominal, floor)
        sizes.append(max(gap.values()))
        if sizes[-1] > 3 * LEVELS[-1]:
            break
    # Make it monotone, so that the inverse is a function; a gap that stops growing leaves the
    # parameter at its limit.
    tops = np.maximum.accumulate(np.maximum(sizes, 1e-6))
    keep = np.concatenate([[True], np.diff(tops) > 1e-3 * tops[:-1]])
    logs = np.log(tops[keep]), np.log(values[: len(tops)][keep])
    found = []
    for level in LEVELS:
        if np.log(level) <= logs[0][0]:
            found.append(float(values[0]) * level / float(tops[0]))
        else:
            found.append(float(np.exp(np.interp(np.log(level), *logs))))
    print(
        f"{name:26s} {' '.join(f'{v:10.3g}' for v in found)} {effect.unit:8s} largest gap"
        f" {tops[-1]:.3g}",
        flush=True,
    )
    return found


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--write", action="store_true", help="put the result into config/plant.yaml"
    )
    parser.add_argument(
        "--missing", action="store_true", help="only effects and laws that have no sizes yet"
    )
    parser.add_argument("--effects", default="", help="only these, comma separated")
    options = parser.parse_args()
    every = [size_name(name, law) for name in EFFECTS for law in range(law_count(name))]
    names = list(parse_effects(",".join(f"{n}=1" for n in options.effects.split(",") if n)))
    path = Path(config_file("plant.yaml"))
    known = set(re.findall(r"^  (\w+): ", path.read_text(encoding="utf-8"), flags=re.M))
    names = [n for n in names or every if not (options.missing and n in known)]
    commands = standard_strikes(7, n=20, repeats=2)
    floor = floors(commands)
    print(
        "floors: " + ", ".join(f"{name} {value:.3g}" for name, value in floor.items()), flush=True
    )
    nominal = observables(
        simulate_commands(commands, Case(repeatability=0.0, noise=0.0), rounded=False)
    )
    for name in names:
        found = ", ".join(f"{v:.3g}" for v in _strengths(name, commands, nominal, floor))
        if options.write:
            _write(path, name, found)
    return 0


def _write(path: Path, name: str, found: str) -> None:
    """Put the sizes of one effect into ``path``."""
    unit = EFFECTS[split_law(name)[0]].unit
    source = "chosen" if name in _BY_CHOICE else f"measured by {_COMMAND}"
    line = f'  {name}: {{value: [{found}], unit: "{unit}", source: "{source}"}}'
    text = path.read_text(encoding="utf-8")
    text, count = re.subn(rf"^  {name}: .*$", line, text, flags=re.M)
    if not count:
        text = text.rstrip("\n") + "\n" + line + "\n"
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    raise SystemExit(main())
