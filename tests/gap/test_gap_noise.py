"""Floor and whitening."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from examples import fewer
from gap_toy import Toy, recordings
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from pianobot_ros.gap import Block, Observable, Signal, diagnose
from pianobot_ros.gap.floor.estimate import estimates, grid, lasting, resolution
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.repeats import split, unshared_inputs
from pianobot_ros.gap.floor.scatter import by_chance
from pianobot_ros.gap.floor.splice import inherited, passed_on
from pianobot_ros.gap.floor.whitening.whiten import Whitener
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem


def test_the_correlation_time_does_not_hang_on_unequal_lengths():
    rng = np.random.default_rng(0)
    times = [np.arange(n) * 0.01 for n in [100] * 3 + [1000] * 6]
    rows = [wander(rng, t, 1.0, 0.05) + 0.1 * rng.normal(size=t.size) for t in times]
    assert split(rows, times)[2] == pytest.approx(0.05, rel=0.5)


def wander(rng, t, sigma, tau):
    x = np.empty(t.size)
    x[0] = sigma * rng.normal()
    for i in range(1, t.size):
        a = np.exp(-(t[i] - t[i - 1]) / tau)
        x[i] = a * x[i - 1] + sigma * np.sqrt(1 - a * a) * rng.normal()
    return x


@fewer(0.15)
@given(
    sigma=st.floats(0.1, 5.0),
    white=st.floats(0.05, 2.0),
    tau=st.floats(0.02, 2.0),
    seed=st.integers(0, 10_000),
)
def test_innovations_of_the_modelled_noise_are_white_and_of_unit_size(sigma, white, tau, seed):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 30, 3000))  # irregular on purpose
    x = wander(rng, t, sigma, tau) + white * rng.normal(size=t.size)
    z = Whitener.of(t, np.full(t.size, white), (sigma, tau)).apply(x[:, None])[:, 0]
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(z[1:] * z[:-1])) < 0.1


def test_whitening_equals_the_dense_inverse_covariance():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 2, 40))
    sigma, tau, white = 0.7, 0.3, rng.uniform(0.2, 0.5, 40)
    covariance = sigma**2 * np.exp(-np.abs(t[:, None] - t) / tau) + np.diag(white**2)
    r = rng.normal(size=40)
    z = Whitener.of(t, white, (sigma, tau)).apply(r[:, None])[:, 0]
    assert z @ z == pytest.approx(r @ np.linalg.solve(covariance, r))
    level = rng.uniform(0.0, 1.0, 40)  # another at each sample
    covariance = np.outer(level, level) * np.exp(-np.abs(t[:, None] - t) / tau) + np.diag(white**2)
    z = Whitener.of(t, white, (level, tau)).apply(r[:, None])[:, 0]
    assert z @ z == pytest.approx(r @ np.linalg.solve(covariance, r))
    covariance += 0.5**2 * np.exp(-np.abs(t[:, None] - t) / 0.01)  # and a fast one beside it
    z = Whitener.of(t, white, (0.5, 0.01), (level, tau)).apply(r[:, None])[:, 0]
    assert z @ z == pytest.approx(r @ np.linalg.solve(covariance, r))


def test_fast_scatter_does_not_pass_for_slow_beside_a_tolerance():
    rng = np.random.default_rng(2)
    blocks = recordings(n=12)
    for b in blocks:
        for signal in b.outputs.values():
            signal.y[:] = wander(rng, signal.t, 0.1, 0.012)
    problem = Problem(Toy(), blocks)
    noise = NoiseModel.by(problem, problem.y.copy(), Options(tolerance=0.5))
    assert np.mean(noise.whiten(problem.y)[problem.obs_of == 1] ** 2) < 1.05


class Spliced(Toy):
    """The force is predicted from the measured motion, whose gain is ``k``."""

    observables = (
        Toy.observables[0],
        replace(Toy.observables[1], spliced="x", gain="k"),
        Toy.observables[2],
    )

    def simulate(self, blocks, values, effects):
        found = super().simulate(blocks, values, effects)
        return [p | ({"f": p["f"] / values["k"]} if "f" in p else {}) for p in found]


def test_behind_a_splice_is_the_floor_of_what_is_spliced_in():
    problem = Problem(Spliced(), recordings(n=30))
    nominal = problem.predict(problem.nominal(), ())
    old = NoiseModel.by(problem, problem.y - nominal, Options())
    noise = passed_on(old, problem.nominal())
    before, found = old.floor, noise.inherited
    x, f = (problem.obs_of == o for o in (0, 1))
    share = before[0] / np.sqrt(np.mean(problem.y[x] ** 2))
    assert np.all(found[~f] == 0.0)
    assert found[f] == pytest.approx(share * np.abs(nominal[f]), rel=2 * share, abs=1e-12)
    assert noise.floor[0] == before[0]
    assert noise.floor[1] == pytest.approx(np.hypot(before[1], np.sqrt(np.mean(found[f] ** 2))))
    wrong = np.where(f, 0.05 * nominal, 0.0)  # five hundredths of the force
    assert np.all(np.abs(noise.normalise(wrong)) < 0.05 / share)
    assert np.sum(noise.whiten(wrong) ** 2) < np.sum(old.whiten(wrong) ** 2)


def test_a_splice_of_nothing_known_is_refused():
    class Lost(Spliced):
        observables = (replace(Spliced.observables[1], spliced="y"), *Toy.observables[::2])

    with pytest.raises(GapError, match="no observable 'y'"):
        Problem(Lost(), recordings(n=3))


def test_a_splice_without_a_gain_is_as_good_as_exact():
    class Plain(Spliced):
        observables = (Toy.observables[0], replace(Spliced.observables[1], gain=""))

    problem = Problem(Plain(), recordings(n=3))
    assert not np.any(inherited(problem, np.ones(2), problem.nominal()))


def test_floor_from_repeats_finds_both_parts():
    problem = Problem(Toy(), recordings(n=30))
    noise = NoiseModel.by(
        problem, problem.y - problem.predict(problem.nominal(), ()), Options(tolerance=0.0)
    )
    force = noise.estimates.noises[1]
    assert force.repeats > 0
    assert force.white == pytest.approx(0.02, rel=0.1)
    assert force.correlated == pytest.approx(0.01, rel=0.5)
    assert force.floor == pytest.approx(np.hypot(0.02, 0.01), rel=0.15)


def test_floor_without_repeats_is_estimated_and_said():
    problem = Problem(Toy(), recordings(n=3))
    noise = NoiseModel.by(problem, problem.y - problem.predict(problem.nominal(), ()), Options())
    assert set(noise.estimates.estimated) == {"x", "f", "onset"}
    assert noise.estimates.noises[0].white == pytest.approx(0.002, rel=0.2)


class Slow(Toy):
    """What follows the measured x: a state that it drives, so that its noise comes out slower."""

    observables = (Toy.observables[0], Observable("z", "force", "z", "m"))
    effects = ()

    def simulate(self, blocks, values, effects):
        return [
            {
                "x": values["k"] * b.inputs["u"].y,
                "z": lfilter([0.2 * values["c"]], [1.0, -0.9], b.outputs["x"].y),
            }
            for b in blocks
        ]


def slow_recordings(repeats: bool) -> list[Block]:
    rng, t = np.random.default_rng(5), np.arange(0.0, 4.0, 0.01)
    out = []
    for k in range(24):
        u = np.sin((1.0 if repeats else 1.0 + 0.1 * k) * t)
        x = u + 0.01 * rng.normal(size=t.size)
        z = lfilter([0.1], [1.0, -0.9], u) + 0.002 * rng.normal(size=t.size)
        signals = {n: Signal(t + 5.0 * k, y) for n, y in (("x", x), ("z", z))}
        condition = "all" if repeats else str(k)
        out.append(Block(str(k), condition, {"u": Signal(t + 5.0 * k, u)}, signals))
    return out


def test_where_nothing_repeats_the_noise_of_what_is_spliced_in_goes_through_the_twin():
    floors = []
    for repeats in (True, False):
        problem = Problem(Slow(), slow_recordings(repeats))
        at = problem.nominal()
        residual = problem.y - problem.predict(at, ())
        found = estimates(problem, residual, Options(tolerance=0.0), at)
        floors.append([n.floor for n in found.noises.values()])
    assert floors[1] == pytest.approx(floors[0], rel=0.1)
    alone = estimates(problem, residual, Options(tolerance=0.0))
    assert alone.noises[1].floor < 0.75 * floors[0][1]


def test_right_parameters_may_pass_on_more_noise_than_nominal_ones():
    rng, t = np.random.default_rng(5), np.arange(0.0, 4.0, 0.01)
    blocks = []
    for k in range(24):
        u = np.sin((1.0 + 0.2 * (k % 4)) * t)
        x = u + 0.05 * rng.normal(size=t.size)
        z = lfilter([0.16], [1.0, -0.9], u) + 0.0005 * rng.normal(size=t.size)
        signals = {n: Signal(t + 5.0 * k, y) for n, y in (("x", x), ("z", z))}
        blocks.append(Block(str(k), str(k % 4), {"u": Signal(t + 5.0 * k, u)}, signals))
    found = diagnose(Slow(), blocks, options=Options(tolerance=1e-3))
    assert found.verdict == "parameters", found.sentence
    assert found.gap.refit == pytest.approx(1.0, abs=0.05)


def test_a_twin_that_noise_breaks_has_the_floor_of_its_residual_alone():
    class Fragile(Slow):
        calls = 0

        def simulate(self, blocks, values, effects):
            if any(b.outputs["x"].y[0] != x for b, x in zip(blocks, self.first, strict=True)):
                raise ValueError("not this start")
            return super().simulate(blocks, values, effects)

    blocks, twin = slow_recordings(False), Fragile()
    twin.first = [float(b.outputs["x"].y[0]) for b in blocks]
    problem = Problem(twin, blocks)
    at = problem.nominal()
    residual = problem.y - problem.predict(at, ())
    with_draws, alone = (
        estimates(problem, residual, Options(), v).noises[1].floor for v in (at, None)
    )
    assert with_draws == alone


@pytest.mark.parametrize(("by", "said"), [(1.0, ["wind"]), (0.01, []), (0.0, [])])
def test_an_input_that_repeats_do_not_share_is_told(by: float, said: list[str]):
    rng, blocks = np.random.default_rng(0), recordings()
    t = blocks[0].inputs["u"].t
    winds = [Signal(t, 5.0 + by * rng.normal() + rng.normal(size=t.size)) for _ in blocks]
    blocks = [
        replace(b, inputs={**b.inputs, "wind": w}) for b, w in zip(blocks, winds, strict=True)
    ]
    assert list(unshared_inputs(Problem(Toy(), blocks))) == said
    alone = [replace(b, condition=b.name) for b in blocks]
    assert not unshared_inputs(Problem(Toy(), alone))
    warned = " ".join(diagnose(Toy(), blocks).warnings)
    assert ("differ in wind: but for" in warned) == bool(said)


def test_what_goes_with_an_input_that_repeats_do_not_share_is_no_scatter():
    rng, blocks = np.random.default_rng(0), []
    for b in recordings(n=24):
        t, x, mean = b.inputs["u"].t, b.outputs["x"], 5.0 * rng.normal()
        wind = Signal(t, mean + rng.normal(size=t.size))
        moved = Signal(x.t, x.y + 0.006 * mean)
        outputs = {**b.outputs, "x": moved}
        blocks.append(replace(b, inputs={**b.inputs, "wind": wind}, outputs=outputs))
    found = diagnose(Toy(), blocks)
    assert found.verdict == "unknown", found.sentence
    assert found.unknown is not None and "wind" in found.unknown.text
    assert any("change with wind" in w for w in found.warnings)


def test_resolution_of_a_coarse_encoder():
    y = np.round(np.sin(np.linspace(0, 20, 4000)) / 0.05) * 0.05
    assert resolution(y) == pytest.approx(0.05)
    assert resolution(np.random.default_rng(0).normal(size=500)) == 0.0


def test_the_grid_of_events_is_not_taken_from_how_far_their_conditions_are_apart():
    rng = np.random.default_rng(0)
    assert grid(np.repeat([0.100, 0.159, 0.230], 5)) == pytest.approx(1e-3)
    assert grid(np.round(rng.random(40), 3)) == pytest.approx(1e-3)
    assert grid(np.repeat(rng.random(4), 5)) == 0.0
    assert grid(np.repeat([0.1, 0.2], 5)) == 0.0


def test_repeats_with_unlike_stamps_do_not_flatter_the_floor():
    rng = np.random.default_rng(3)
    blocks = recordings(n=30)
    for k, b in enumerate(blocks):
        for signal in b.outputs.values():
            signal.t[:] = signal.t + (k % 3) * 0.4 * np.median(np.diff(signal.t))
            signal.y[:] = 0.05 * rng.normal(size=signal.y.size)
    problem = Problem(Toy(), blocks)
    noise = NoiseModel.by(problem, problem.y.copy(), Options(tolerance=0.0))
    assert noise.estimates.noises[1].white == pytest.approx(0.05, rel=0.05)


def test_what_the_twin_is_wrong_by_does_not_average_out_over_repeats():
    def sure(repeats):
        problem = Problem(Toy(), recordings(n=3 * repeats))
        options = Options(tolerance=0.05)
        noise = NoiseModel.by(problem, problem.y - problem.predict(problem.nominal(), ()), options)
        shape = np.where(problem.obs_of == 1, 0.02, 0.0)
        return float(np.sum(noise.whiten(shape) ** 2))

    assert sure(8) < 2.0 * sure(4) * 0.8


def scatter_of_events(rows):
    """Scatter of an event by its values (conditions, repeats), and how many of them are strays."""
    count = rows.size
    blocks = recordings(1, count, conditions=len(rows))
    values = [0.01 * x for x in rows.T.ravel()]
    blocks = [replace(b, events={"onset": x}) for b, x in zip(blocks, values, strict=True)]
    problem = Problem(Toy(), blocks)
    found = estimates(problem, problem.y.copy(), Options())
    lone = [c for c in found.lone if problem.observables[c.observable].name == "onset"]
    told = [int(n) for w in found.erratic for n in re.findall(r"^onset \((\d+) of", w)]
    return 100.0 * found.noises[2].white, len(lone) + sum(told)


@fewer(0.3)
@given(seed=st.integers(0, 10_000), faults=st.integers(0, 8))
def test_a_rare_fault_does_not_raise_the_floor(seed, faults):
    rng = np.random.default_rng(seed)
    rows = np.array([10.0 * k + rng.normal(size=4) for k in range(12)])
    for k in range(faults):
        rows[k, int(rng.integers(4))] += 50.0 * rng.choice((-1.0, 1.0))
    scatter, astray = scatter_of_events(rows)
    # of 48 normal deviates one may look rare by itself
    assert faults <= astray <= faults + 1
    assert scatter == pytest.approx(1.0, rel=0.5)


def test_what_happens_often_is_scatter():
    rng = np.random.default_rng(1)
    rows = [rng.normal(size=4) + 50.0 * np.array([0.0, 1.0, 0.0, 1.0]) for _ in range(12)]
    scatter, astray = scatter_of_events(np.array(rows))
    assert astray == 0
    assert scatter > 20.0


def test_one_stray_of_some_dozens_is_chance_and_a_tenth_of_them_is_not():
    assert [by_chance(n) for n in (12, 36, 40, 48)] == [1, 1, 1, 1]
    assert by_chance(400) < 10


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("step", [0.002, 0.01])
def test_how_long_a_signal_stays_the_same_is_no_matter_of_noise_or_rate(noise, step):
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 8.0, step)
    y = np.sin(2.0 * np.pi * 0.5 * t) + noise * rng.normal(size=t.size)
    halves = [(t[: t.size // 2], y[: t.size // 2]), (t[t.size // 2 :], y[t.size // 2 :])]
    for pieces in ([(t, y)], halves):
        assert lasting(pieces, noise**2) == pytest.approx(1.0 / np.pi, rel=0.3)


def test_what_is_only_noise_stays_the_same_for_ever():
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 4.0, 0.01)
    assert lasting([(t, 2.0 + 0.1 * rng.normal(size=t.size))], 0.011) == np.inf
    assert lasting([(t, np.full(t.size, 2.0))], 0.0) == np.inf
    assert lasting([(t[:2], np.array([1.0, np.nan]))], 0.0) == np.inf


def test_the_twins_error_lasts_no_longer_than_the_signal_nor_than_a_tenth_of_a_block():
    """Taken to last for a tenth of a long block, what two laws differ by passed for something that
    no law may leave.
    """
    problem = Problem(Toy(), recordings(n=6))
    found = estimates(problem, problem.y - problem.predict(problem.nominal(), ()), Options())
    cell = problem.cells[0]
    for lasts, tau in ((0.01, 0.01), (np.inf, 0.1 * float(np.ptp(cell.t)))):
        noises = {o: replace(n, lasts=lasts) for o, n in found.noises.items()}
        noise = NoiseModel(problem, Options(), replace(found, noises=noises))
        assert noise.tolerance_of(cell)[1] == pytest.approx(tau, rel=0.01)
