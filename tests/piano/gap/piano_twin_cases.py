from __future__ import annotations

from functools import lru_cache

from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes


@lru_cache(maxsize=32)
def record(
    effects: tuple[tuple[str, float], ...] = (),
    errors: tuple[tuple[str, float], ...] = (),
    seed: int = 7,
    strikes: int = 16,
    encoder: bool = True,
) -> Recording:
    """A recording of the emulated cell; the same arguments give the same one without simulating
    again.
    """
    commands = standard_strikes(seed, strikes)
    return simulate_cell(
        commands, effects=dict(effects), parameter_errors=dict(errors), seed=seed, encoder=encoder
    )
