"""What the sensors make of the true motion: force sensor, key angle, MIDI contacts and clocks."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import njit

from foreign_cell.law_table import Effects, acting
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels

__all__ = [
    "angle_shown",
    "contact_angles",
    "force_shown",
    "mains_hum",
    "notes_heard",
    "sensor_clock",
]

_FSR = {"fsr_hysteresis": 0, "fsr_creep": 1, "fsr_saturation": 2}
_MAINS = 50.07  # Hz
_ECCENTRIC = 0.02  # rad of a turn of the encoder
_EVENTS = 2000  # draws of the MIDI's scatter


def force_shown(
    force: Array, acceleration: Array, radius: float, effects: Effects, tick: float
) -> Array:
    """Forces (n,), N, that the sensor feels of true ``force`` (n,), N, every ``tick`` s, without
    its gain. It sits at ``radius`` m on the key, whose ``acceleration`` (n,) is in rad/s^2.
    """
    shown = force.copy()
    if "fsr_inertia" in effects:
        inertia = acting(effects, "fsr_inertia").strength
        shown = np.maximum(shown + inertia * acceleration * radius, 0.0)
    for name, kind in _FSR.items():
        if name in effects:
            law, strength = acting(effects, name)
            shown = np.asarray(_fsr(shown, tick, kind, law, strength))
    return np.asarray(shown)


def mains_hum(time: Array, effects: Effects) -> Array:
    """What the mains adds to the force sensor at ``time`` (n,), s, in N."""
    return acting(effects, "mains_hum").strength * np.sin(2 * np.pi * _MAINS * time)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _fsr(force: Array, tick: float, kind: int, law: int, strength: float) -> Array:
    """The force sensor's laws.

    Hysteresis: a lobe on the way down from the highest force, or eight plays (Prandtl and
    Ishlinskii, Kuhnen 2003). Creep: stretched exponential under load (Kohlrausch 1854), or traps
    that fill and empty. Saturation: exponential approach to a ceiling, or a soft knee at 3 N.
    """
    n = len(force)
    out = np.empty(n)
    highest, loaded, filled = 0.0, 0.0, 0.0
    play = np.zeros(8)
    for i in range(n):
        x = force[i]
        shown = x
        if kind == 0 and law == 1:
            if x > highest or x < 0.02:
                highest = x
            if highest > 0.02:
                shown = x + 2 * strength * (highest - x) * x / highest
        elif kind == 0:
            mean = 0.0
            for k in range(8):
                half = 0.04 * 1.7**k
                play[k] = min(max(play[k], x - half), x + half)
                mean += play[k] / 8
            shown = x + strength * 2 * (max(mean, 0.0) - x) if x > 0.0 else 0.0
        elif kind == 1 and law == 1:
            loaded = loaded + tick if x > 0.03 else 0.0
            shown = x * (1 + strength * (1 - math.exp(-math.sqrt(loaded / 0.5))))
        elif kind == 1:
            filled += tick * ((x / 3.0) * (1 - filled) / 0.15 - filled / 0.8)
            shown = x * (1 + strength * filled)
        elif law == 1:
            ceiling = 2.5 / strength
            shown = ceiling * (1 - math.exp(-x / ceiling))
        else:
            knee = math.log(1 + math.exp((x - 3.0) / 0.3)) - math.log(1 + math.exp(-10.0))
            shown = x - 2.5 * strength * 0.3 * knee
        out[i] = shown
    return out


def angle_shown(angle: Array, effects: Effects) -> Array:
    """Key angles (n,), rad, by an encoder whose axis may lie beside that of its disc."""
    error = acting(effects, "encoder_eccentricity").strength
    return angle + error * np.sin(2 * np.pi * angle / _ECCENTRIC) if error else angle


def sensor_clock(time: Array, effects: Effects) -> Array:
    """What the sensors' clock shows, s, at ``time`` (n,), s from the start, ascending. Law 1: its
    rate error falls to 40 % after 40 % of the session.
    """
    skew = acting(effects, "clock_skew")
    if skew.law != 1:
        return time
    turn, error = 0.4 * time[-1], skew.strength
    after = time + error * 0.4 * time[-1] + 0.4 * error * (time - turn)
    return np.where(time < turn, time * (1 + error), after)


def contact_angles(midi: Midi, effects: Effects) -> tuple[float, float]:
    """Key angles, rad, at which note-on and note-off are told."""
    on, off = midi.trigger_on, midi.trigger_off
    offset = acting(effects, "trigger_offset")
    if offset.law == 1:
        return on - offset.strength, off - 0.8 * offset.strength
    if offset.law == 2:
        return on + offset.strength, off + 0.5 * offset.strength
    return on, off


def notes_heard(
    contacts: Array, gains: tuple[float, float], effects: Effects, drawn: tuple[int, float]
) -> list[tuple[float, bool, int]]:
    """Time, s from the start, on or off, and velocity of the MIDI events of ``contacts`` (n, 3):
    time s, 1 for note-on, speed of the key rad/s.

    ``gains`` are the velocity by m/s and the radius, m; ``drawn`` the seed and the factor of the
    noise, without which velocities are not whole.
    """
    levels, (seed, noise) = noise_levels(), drawn
    random = np.random.default_rng([seed, 0xF2])
    loud, late = random.standard_normal(_EVENTS), random.standard_normal(_EVENTS)
    even, more = random.random(_EVENTS), random.random(_EVENTS)
    normal = random.standard_normal(_EVENTS)
    heard = []
    for i, (time, told, speed) in enumerate(contacts):
        on = bool(told > 0.5)
        velocity = _velocity(gains[0] * speed * gains[1], effects)
        velocity += noise * levels.midi_velocity * loud[i]
        velocity = min(max(round(velocity) if noise else velocity, 1), 127)
        at = time + levels.midi_time * noise * abs(late[i])
        at += _latency(effects, on, even[i])
        at += _jitter(effects, even[i], more[i], normal[i])
        skew = acting(effects, "clock_skew")
        if skew.law == 2:
            at = at * (1 + skew.strength)
        heard.append((at, on, int(velocity) if noise else cast(int, velocity)))
    return heard


def _velocity(velocity: float, effects: Effects) -> float:
    """MIDI velocity by a curve in place of the line. Law 1: a parabola added; law 2: arctangent."""
    curve = acting(effects, "midi_velocity_curve")
    x = min(velocity / 127, 1.0)
    if curve.law == 1:
        return velocity + curve.strength * 127 * 1.5 * x * (1 - x)
    if curve.law == 2:
        bent = 127 * math.atan(1.6 * x) / math.atan(1.6)
        return velocity + curve.strength * (bent - velocity)
    return velocity


def _latency(effects: Effects, on: bool, even: float) -> float:
    """Wait of an event, s; ``even`` is drawn from 0 to 1."""
    law, wait = acting(effects, "midi_latency")
    if law == 1:
        return wait * (1.0 if on else 0.75)
    return wait * (0.85 + 0.3 * even) if law == 2 else 0.0


def _jitter(effects: Effects, even: float, more: float, normal: float) -> float:
    """Random wait of an event, s. Law 1: lognormal (Aitchison and Brown 1957); law 2: half of the
    events wait evenly up to four times the mean.
    """
    law, wait = acting(effects, "midi_jitter")
    if law == 1:
        return wait * math.exp(0.8 * normal - 0.32)
    return wait * 4 * more if law == 2 and even < 0.5 else 0.0
