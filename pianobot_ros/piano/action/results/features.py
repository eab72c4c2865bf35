"""What is measured on a trajectory: the named features of Figs. 9 and 10, and the timing of a
struck note.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.piano.action.hybrid.action_model import PARTS, build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Event, Simulator, Trajectory
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = [
    "StepFeatures",
    "StrikeTiming",
    "repeated_note",
    "step_features",
    "step_response",
    "strike_timing",
    "strikes_string",
]

_SETTLED = 0.03  # s after bottoming within which its force peak lies


@dataclass(frozen=True)
class StepFeatures:
    """Features of the 2 A step. Times [s] from the step, forces [N] at the load cell, displacements
    [m].

    ``bottoms`` key meets the front rail, ``leaves`` hammer flies free, ``lands`` it is back;
    ``bottoms_first`` is the paper's order. ``backdrive`` is how far the landing hammer pushes key
    and armature up.
    """

    bottoms: float
    leaves: float
    lands: float
    bottoms_first: bool
    backdrive: float
    initial_peak: float
    bottoming_peak: float
    bottoming_peak_time: float
    landing_excursion: float
    modes: tuple[str, ...]


@dataclass(frozen=True)
class StrikeTiming:
    """Timing of one struck note: instants [s] and the hammer head's speed on meeting the string
    [m/s].

    ``free_flight`` is from let-off to string; ``bottom_after_contact`` from string to key bottom
    (negative: before); ``midway_lag`` by how much the hammer passes half its way later than the key
    does.
    """

    hammer_speed: float
    let_off: float
    contact: float
    bottom: float
    free_flight: float
    bottom_after_contact: float
    midway_lag: float


def step_response(parameters: ActionParameters, end: float = 1.0) -> Trajectory:
    """The step of Figs. 9 and 10: the configured current on the paper's hybrid model, to ``end``
    [s].
    """
    force = parameters.armature.motor_constant * parameters.rig.step_current
    return Simulator(build_model(parameters)).run(ForceProfile.step(force), end)


def step_features(path: Trajectory) -> StepFeatures:
    """Measure the features of a step. Raises :class:`PianobotError` if the key does not bottom or
    the hammer not return.
    """
    bottoms = _first(path, "bottom").time
    leaves = _first(path, "release").time
    lands = next((e.time for e in path.events if e.rule == "land" and e.time > leaves), None)
    if lands is None:
        raise PianobotError(
            f"the hammer is still in flight after {path.end} s: simulate for longer"
        )
    history = path.sample(5e-5)
    t, force, key = history.time, history.load_cell, history.key
    early = (t > 0) & (t < bottoms)
    # The armature's own jump at the step is not a peak of the action: look past the first sample.
    initial = float(force[early].max())
    near = (t >= bottoms) & (t <= bottoms + _SETTLED)
    peak = int(np.flatnonzero(near)[np.argmax(force[near])])
    before = float(np.interp(lands, t, key))
    later = t > lands
    level = float(np.interp(lands - 1e-3, t, force))
    return StepFeatures(
        bottoms=bottoms,
        leaves=leaves,
        lands=lands,
        bottoms_first=bottoms < leaves,
        backdrive=float(before - key[later].min()),
        initial_peak=initial,
        bottoming_peak=float(force[peak]),
        bottoming_peak_time=float(t[peak]),
        landing_excursion=float(np.max(np.abs(force[later] - level))),
        modes=tuple(path.modes()),
    )


def strike_timing(path: Trajectory) -> StrikeTiming:
    """Timing of the first strike of a model with string and let-off. Raises :class:`PianobotError`
    if none sounds.
    """
    contact = _first(path, "string made")
    let_off = _first(path, "jack out")
    bottom = _first(path, "bottom")
    half = path.model.parameters.string.height / 2
    history = path.sample(2e-5)
    key = float(history.time[np.argmax(history.key > half)])
    hammer = float(history.time[np.argmax(history.hammer > half)])
    return StrikeTiming(
        hammer_speed=float(contact.state[3]) * path.model.parameters.hammer.advantage,
        let_off=let_off.time,
        contact=contact.time,
        bottom=bottom.time,
        free_flight=contact.time - let_off.time,
        bottom_after_contact=bottom.time - contact.time,
        midway_lag=hammer - key,
    )


def strikes_string(path: Trajectory) -> list[float]:
    """Instants [s] at which the hammer meets the string."""
    return [e.time for e in path.events if e.rule == "string made"]


def repeated_note(
    parameters: ActionParameters,
    *,
    lever: bool,
    press: float = 5.0,
    ease: float = 1.5,
    end: float = 0.6,
) -> Trajectory:
    """Press with ``press`` [N], ease to ``ease`` [N] so that the key returns only part of its way,
    and press again.

    The same forces with and without the repetition ``lever``; all other parts are there.
    """
    parts = PARTS if lever else PARTS - {"repetition_lever"}
    profile = ForceProfile.steps([(0.0, press), (0.15, ease), (0.23, press), (0.37, 0.0)])
    return Simulator(build_model(parameters, parts)).run(profile, end)


def _first(path: Trajectory, rule: str) -> Event:
    for event in path.events:
        if event.rule == rule:
            return event
    raise PianobotError(f"no '{rule}' within {path.end} s: press harder or simulate for longer")
