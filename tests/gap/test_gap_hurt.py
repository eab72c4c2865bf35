"""Whatever happened to a recording, it is judged as far as it goes or refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from examples import fewer
from gap_toy import Toy, recordings
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from pianobot_ros.gap import Block, GapError, Signal, diagnose
from pianobot_ros.gap.problem.recordings.intake import sound

Change = Callable[[np.random.Generator, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def short(n: int, **truth: float) -> list[Block]:
    """Blocks of 50 samples."""

    def thin(s: Signal) -> Signal:
        return Signal(s.t[::8], s.y[::8], s.unit)

    return [
        replace(
            b,
            inputs={k: thin(s) for k, s in b.inputs.items()},
            outputs={k: thin(s) for k, s in b.outputs.items()},
        )
        for b in recordings(n=n, **truth)
    ]


def window(rng, t, y):
    a, b = sorted(rng.integers(0, t.size + 1, 2))
    keep = np.ones(t.size, bool)
    keep[a:b] = False
    return np.where(keep, t, t), np.where(keep, y, np.nan)


def nothing(_, t, y):
    return t[:0], y[:0]


def single(_, t, y):
    return t[:1], y[:1]


def reorder(rng, t, y):
    order = rng.permutation(t.size)
    return t[order], y[order]


def duplicate(rng, t, y):
    a, b = sorted(rng.integers(0, t.size + 1, 2))
    t[a:b] = t[min(a, t.size - 1)]
    return t, y


def missing(rng, t, y):
    y[rng.integers(0, t.size, 5)] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
    return t, y


def stamps(rng, t, y):
    t[rng.integers(0, t.size, 2)] = rng.choice([np.nan, np.inf])
    return t, y


def constant(_, t, y):
    return t, np.full_like(y, y[0])


def forward(rng, t, y):
    t[rng.integers(0, t.size) :] += 5.0
    return t, y


def back(rng, t, y):
    t[rng.integers(0, t.size) :] -= 3.0
    return t, y


def spike(rng, t, y):
    y[rng.integers(0, t.size)] = 1e12
    return t, y


SAMPLES: tuple[Change, ...] = (
    window,
    nothing,
    single,
    reorder,
    duplicate,
    missing,
    stamps,
    constant,
    forward,
    back,
    spike,
)


def one_signal(change: Change, rng: np.random.Generator, blocks: list[Block]) -> list[Block]:
    i = int(rng.integers(len(blocks)))
    name = str(rng.choice(["x", "f"]))
    s = blocks[i].outputs.get(name)
    if s is None or s.t.size == 0:
        return blocks
    changed = Signal(*change(rng, s.t.copy(), s.y.copy()), s.unit)
    outputs = {**blocks[i].outputs, name: changed}
    return [*blocks[:i], replace(blocks[i], outputs=outputs), *blocks[i + 1 :]]


def dead(rng, blocks):
    name = str(rng.choice(["x", "f"]))
    return [
        replace(
            b,
            outputs={
                k: Signal(s.t, np.ones_like(s.y)) if k == name else s for k, s in b.outputs.items()
            },
        )
        for b in blocks
    ]


def lost(rng, blocks):
    name = str(rng.choice(["x", "f"]))
    return [replace(b, outputs={k: s for k, s in b.outputs.items() if k != name}) for b in blocks]


def bare(_, blocks):
    return [replace(blocks[0], outputs={}), *blocks[1:]]


def silent(rng, blocks):
    value = rng.choice([np.nan, np.inf, 1e200])
    return [replace(blocks[0], events={"onset": float(value)}), *blocks[1:]]


def unplayed(_, blocks):
    return [replace(blocks[0], inputs={}), *blocks[1:]]


def one(_, blocks):
    return blocks[:1]


def one_condition(_, blocks):
    return [replace(b, condition="same", history="x", attributes={}) for b in blocks]


def phases(_, blocks):
    return [
        replace(b, phases={"early": (np.nan, 2.0)}, attributes={"rate": np.nan}) for b in blocks
    ]


BLOCKS = (dead, lost, bare, silent, unplayed, one, one_condition, phases)


@pytest.mark.long
@fewer(0.3, suppress=list(HealthCheck))
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(1, 5),
    truth=st.sampled_from([{}, {"fc": 0.1}, {"k": 1.1}, {"odd": 0.1}]),
    changes=st.lists(st.sampled_from([*SAMPLES, *BLOCKS]), min_size=1, max_size=4),
)
def test_a_hurt_recording_is_judged_or_refused_in_one_line(seed, n, truth, changes):
    rng = np.random.default_rng(seed)
    blocks = short(n, **truth)
    for change in changes:
        blocks = change(rng, blocks) if change in BLOCKS else one_signal(change, rng, blocks)
    try:
        with np.errstate(all="ignore"):
            found = diagnose(Toy(), blocks, budget=5000)
    except GapError as error:
        assert "\n" not in str(error)
        return
    document = found.to_json()
    json.dumps(document, allow_nan=False)
    assert sum(c["probability"] for c in document["candidates"]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [(nothing, "no samples"), (back, "stamps that step back"), (constant, "stands still")],
)
def test_what_cannot_be_used_is_left_out_counted_and_said_once(change, said):
    blocks = recordings(fc=0.1)
    rng = np.random.default_rng(0)
    for i in (1, 5):
        s = blocks[i].outputs["f"]
        changed = Signal(*change(rng, s.t.copy(), s.y.copy()), s.unit)
        blocks[i] = replace(blocks[i], outputs={**blocks[i].outputs, "f": changed})
    found = diagnose(Toy(), blocks)
    (warning,) = [w for w in found.warnings if said in w]
    assert "f " in warning
    assert "2 of 12" in warning
    assert found.effects[0].name == "friction"


@pytest.mark.parametrize(("every", "count"), [(12, 0), (8, 1)])
def test_stamps_are_sorted_where_a_small_share_of_them_steps_back(every, count):
    block = recordings(n=1)[0]
    s = block.outputs["f"]
    at = np.arange(0, s.t.size - 1, every)
    order = np.arange(s.t.size)
    order[at], order[at + 1] = at + 1, at
    swapped = replace(block, outputs={**block.outputs, "f": Signal(s.t[order], s.y[order], s.unit)})
    assert len(sound([swapped], Toy.observables)[1]) == count


def test_a_block_that_the_twin_cannot_simulate_is_left_out():
    blocks = unplayed(None, recordings(fc=0.1))
    found = diagnose(Toy(), blocks)
    assert any("1 of 12 blocks" in w for w in found.warnings)
    assert found.provenance["blocks"] == 11
    assert found.effects[0].name == "friction"


def test_a_twin_that_needs_a_signal_loses_the_block_where_that_cannot_be_used():
    class Needy(Toy):
        def simulate(self, blocks, values, effects):
            _ = [b.outputs["f"].y[0] for b in blocks]
            return super().simulate(blocks, values, effects)

    blocks = recordings(fc=0.1)
    s = blocks[5].outputs["f"]
    dead = Signal(s.t, np.full_like(s.y, s.y[0]), s.unit)
    blocks[5] = replace(blocks[5], outputs={**blocks[5].outputs, "f": dead})
    found = diagnose(Needy(), blocks)
    (warning,) = [w for w in found.warnings if "1 of 12 blocks" in w]
    assert "without f" in warning
    assert not any("simulations failed" in w for w in found.warnings)
    assert found.provenance["blocks"] == 11
    assert found.effects[0].name == "friction"
