"""The plant by another author, ``benchmarks/foreign_cell/``: nominally the emulated cell, and every
law of its table acts.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from foreign_cell.draw_cases import SETS, draw_set
from foreign_cell.law_table import FAMILIES, IN_LIBRARY, Acting
from foreign_cell.size_up import gaps, observables
from foreign_cell.whole_cell import play

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes
from pianobot_ros.piano.gap.effects import NAMES

COARSE = 1e-4  # s, twice the plant's own step


@pytest.fixture(scope="module")
def commands() -> Commands:
    return standard_strikes(2, 5)  # with two pressures


@pytest.fixture(scope="module")
def nominal(commands: Commands) -> Mapping[str, Array]:
    return observables(play(commands, {}, {}, 5, 0.0, 0.0, COARSE))


@pytest.mark.long
def test_nominal_strikes_agree_with_the_emulator_well_within_a_floor(
    commands: Commands, nominal: Mapping[str, Array]
) -> None:
    case = Case(repeatability=0.0, noise=0.0)
    emulated = simulate_commands(commands, case, encoder=True, rounded=False)
    own = observables(play(commands, {}, {}, 5, 0.0, 0.0))
    assert np.isfinite(own["onset"]).all()
    assert max(gaps(own, observables(emulated)).values()) < 0.2
    assert max(gaps(nominal, own).values()) < 0.2  # and so with coarser steps


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_every_law_changes_something_and_laws_differ(
    commands: Commands, nominal: Mapping[str, Array], name: str
) -> None:
    family = FAMILIES[name]
    changed = []
    for k in range(len(family.phrases)):
        strength = (family.start[k] * family.bound[k]) ** 0.5
        recording = play(commands, {name: Acting(k + 1, strength)}, {}, 5, 0.0, 0.0, COARSE)
        changed.append(observables(recording))
    assert all(max(gaps(one, nominal).values()) > 0.5 for one in changed)
    assert all(max(gaps(one, changed[0]).values()) > 0.1 for one in changed[1:])


@pytest.mark.long
def test_a_recording_repeats_with_its_seed(commands: Commands) -> None:
    effects = {"regulator_hysteresis": Acting(2, 1000.0), "midi_jitter": Acting(1, 0.005)}
    first, again, other = (play(commands, effects, {}, seed) for seed in (7, 7, 8))
    for name, series in first.signals.items():
        np.testing.assert_array_equal(series.value, again.signals[name].value)
    assert first.notes == again.notes
    assert first.notes != other.notes


def test_the_library_has_all_families_but_those_outside() -> None:
    assert set(IN_LIBRARY) == set(NAMES)


@pytest.mark.parametrize("name", SETS)
def test_a_set_is_always_the_same_and_of_every_kind(name: str) -> None:
    drawn = draw_set(SETS[name])
    assert drawn == draw_set(SETS[name])
    kinds = [cell.kind for cell in drawn]
    counts = {kind: kinds.count(kind) for kind in kinds}
    assert counts == {"effect": 26, "none": 4, "parameters": 4, "unknown": 5, "two": 3}


def test_the_development_set_is_the_one_that_was_scored() -> None:
    first = draw_set(SETS["dev"])[0]
    assert (first.seed, first.strike_seed) == (1699912881, 1143945884)
    assert [(e.name, e.law) for e in first.effects] == [("hammer", 1)]
