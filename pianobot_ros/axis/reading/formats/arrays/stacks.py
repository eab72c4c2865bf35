"""Arrays of many runs at once, as (time, run, joint) or (run, time, joint)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.table import FEWEST, JOINTS, RUNS
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.vocabulary import BARE
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

__all__ = ["runs_apart"]

SIGNALS = {"position", "command", "velocity", "effort", "command effort", "error"}
SMOOTH = 0.2
CLEARLY = 4.0
"""Steps along time are that small a part of what varies, and smaller than from run to run."""


def runs_apart(
    path: Path, arrays: Mapping[str, Array], joints: Sequence[str]
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Arrays without axes of length 1; those of three axes as rows of one run after the other, with
    the run's number as `episode`, and a note on it. Raises GapError if no axis is clearly the time.
    """
    held = _squeezed(arrays)
    flat = {k: x for k, x in held.items() if x.ndim < 3}
    deep = {k: x for k, x in held.items() if x.ndim == 3}
    said = {k: meaning(k) for k in held}
    if not deep or any(said[k].role == "position" and said[k].rank < BARE for k in flat):
        return flat, ()  # what has three axes beside positions of two is no joints
    deep = {k: x for k, x in deep.items() if said[k].role in SIGNALS} or deep
    (shape, _), *_ = Counter(x.shape[:2] for x in deep.values()).most_common(1)
    deep = {k: x for k, x in deep.items() if x.shape[:2] == shape}
    run, time, joint = _axes(path, deep, flat, said, joints)
    first = next(iter(deep.values()))
    runs, samples = first.shape[run], first.shape[time]
    kept = min(runs, RUNS)
    out: dict[str, Array] = {}
    for key, x in deep.items():
        if x.shape[run] == runs and x.shape[time] == samples:
            out[key] = np.moveaxis(x, (run, time, joint), (0, 1, 2))[:kept]
    for key, x in flat.items():
        if {run, time} == {0, 1} and x.shape == shape:
            out[key] = (x if run == 0 else x.T)[:kept]
        elif x.shape[0] == samples:  # what all runs share
            out[key] = np.broadcast_to(x, (kept, *x.shape))
    rows = {k: x.reshape(kept * samples, *x.shape[2:]) for k, x in out.items()}
    rows["episode"] = np.repeat(np.arange(kept, dtype=float), samples)
    more = f", of which the first {kept} are read" if kept < runs else ""
    axes = "x".join(map(str, first.shape))
    return rows, (f"arrays of {axes} are {runs} runs of {samples} samples each{more}",)


def _squeezed(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Arrays without axes of length 1, but for a last one beside runs of several joints."""
    wide = {x.shape[:2] for x in arrays.values() if x.ndim == 3 and 1 not in x.shape}
    return {k: x if x.shape[:2] in wide else np.squeeze(x) for k, x in arrays.items()}


def _axes(
    path: Path,
    deep: Mapping[str, Array],
    flat: Mapping[str, Array],
    said: Mapping[str, Meaning],
    joints: Sequence[str],
) -> tuple[int, int, int]:
    """Which axis counts runs, samples and joints: joints by their names, else last; time by stamps,
    by its length, or because what moves is smooth along it.
    """
    first = next(iter(deep.values()))
    named = [k for k in range(3) if first.shape[k] == len(joints)]
    joint = named[0] if len(named) == 1 else 2
    left = [k for k in range(3) if k != joint]
    stamps = {x.size for k, x in flat.items() if said[k].role == "time" and x.ndim == 1}
    places = [x for k, x in deep.items() if said[k].role == "position"] or list(deep.values())
    for time in (
        [k for k in left if first.shape[k] in stamps],
        [k for k in left if first.shape[k] >= FEWEST],
        _smooth(places, left),
    ):
        if len(time) == 1 and first.shape[joint] <= JOINTS:
            (run,) = (k for k in left if k != time[0])
            return run, time[0], joint
    key = next(iter(deep))
    raise GapError(
        f"{path.name}: {key} has {'x'.join(map(str, first.shape))} numbers, and nothing tells which"
        " axis is the time; save a time array as long as that axis, or one run alone (time, joint)"
    )


def _smooth(arrays: Collection[Array], axes: Sequence[int]) -> list[int]:
    """The axis along which numbers change little by little, if it is one alone."""
    rough = [float(np.median([_roughness(x, k) for x in arrays])) for k in axes]
    return [
        k
        for k, own, other in zip(axes, rough, rough[::-1], strict=True)
        if own < SMOOTH and other > CLEARLY * own
    ]


def _roughness(y: Array, axis: int) -> float:
    """Squares of the steps along an axis as a part of the variation along it; inf if none varies,
    as where all runs are the same.
    """
    x = y.astype(float)
    x = np.where(np.isfinite(x), x, 0.0)
    all_of_it = float(np.sum((x - x.mean(axis, keepdims=True)) ** 2))
    return float(np.sum(np.diff(x, axis=axis) ** 2)) / all_of_it if all_of_it > 0 else np.inf
