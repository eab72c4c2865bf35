"""What drifts over the session, or depends on what came before, is a gap and no scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Observable, Parameter, Signal, diagnose
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.repeats import repeats
from pianobot_ros.gap.floor.session import courses
from pianobot_ros.gap.floor.session.courses import find_drift, without_courses
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem

SHARE = Options().calibration.material_share


def session(seed: int, c_of, n: int = 24):
    """Blocks one after the other whose stiffness `c` is a function of the session's share."""
    blocks = []
    for i, block in enumerate(recordings(seed, n)):
        x, f = block.outputs["x"], block.outputs["f"]
        more = (c_of(i / n) - 0.5) * x.y
        late = [
            Signal(s.t + 5.0 * i, s.y, s.unit)
            for s in (x, Signal(f.t, f.y + more, f.unit), block.inputs["u"])
        ]
        phases = {n: (a + 5.0 * i, b + 5.0 * i) for n, (a, b) in block.phases.items()}
        outputs = {"x": late[0], "f": late[1]}
        blocks.append(replace(block, outputs=outputs, inputs={"u": late[2]}, phases=phases))
    return blocks


def residual_and_jacobian(problem):
    base = problem.predict(problem.nominal(), ())
    columns = [
        problem.predict(problem.nominal() | {p.name: p.nominal * 1.01}, ()) - base
        for p in problem.parameters
    ]
    return problem.y - base, np.column_stack(columns)


def gives_way(x: float) -> float:
    """A stiffness that changes once, in mid-session."""
    return 0.5 + 0.15 * (x > 0.4)


@pytest.mark.parametrize(
    "c_of", [lambda x: 0.5 + 0.3 * x, lambda x: 0.5 + 0.2 * np.exp(-x / 0.2), gives_way]
)
def test_drifting_parameter_is_found_and_does_not_raise_the_floor(c_of):
    problem = Problem(Toy(), session(1, c_of))
    residual, jacobian = residual_and_jacobian(problem)
    drift = find_drift(problem, residual, jacobian, SHARE)
    assert drift is not None and drift.parameter == "c"
    force = problem.obs_of == 1
    with_it, without = (
        NoiseModel.by(problem, r, Options()).floor[1] for r in (residual, residual - drift.residual)
    )
    assert without < 0.9 * with_it
    steady = Problem(Toy(), session(1, lambda _: 0.5))
    expected = NoiseModel.by(steady, residual_and_jacobian(steady)[0], Options()).floor[1]
    assert without == pytest.approx(expected, rel=0.15)
    assert np.any(drift.residual[force] != 0)


def test_a_step_shows_where_each_condition_has_three_repeats_only():
    """Their orders are too few for any to be rare."""
    problem = Problem(Toy(), session(1, gives_way, n=9))
    drift = find_drift(problem, *residual_and_jacobian(problem), SHARE)
    assert drift is not None and drift.parameter == "c"
    own = [drift.residual[(problem.obs_of == 1) & (problem.block_of == b)] for b in range(9)]
    size = np.array([np.linalg.norm(x) for x in own])
    assert size[4:].max() < 0.9 * size[:4].min()  # about its mean, the longer part moves less


def at_temperatures(seed: int, per_degree: float):
    """The session at temperatures that follow no course, which change the stiffness."""
    warm = np.random.default_rng(seed).uniform(20.0, 40.0, 24)
    blocks = session(1, lambda x: 0.5 + per_degree * (warm[round(24 * x)] - 30.0))
    return [replace(b, attributes={"temperature": t}) for b, t in zip(blocks, warm, strict=True)]


@pytest.mark.parametrize("seed", range(3))
def test_what_goes_with_an_attribute_is_no_scatter(seed: int):
    problem = Problem(Toy(), at_temperatures(seed, 0.02))
    residual, jacobian = residual_and_jacobian(problem)
    drift = find_drift(problem, residual, jacobian, SHARE)
    assert drift is not None and (drift.parameter, drift.attribute) == ("c", "temperature")
    left, names = without_courses(problem, residual, SHARE)
    assert names == {"f": "temperature"}
    for gone in (residual - drift.residual, left):
        floor = NoiseModel.by(problem, gone, Options()).floor[1]
        assert floor < 0.7 * NoiseModel.by(problem, residual, Options()).floor[1]
    said = "\n".join(diagnose(Toy(), at_temperatures(seed, 0.02)).warnings)
    assert "repeats differ as if c went with temperature: it counts as gap" in said


def test_the_time_of_the_session_is_tried_once_whatever_it_is_called():
    warm = at_temperatures(0, 0.0)
    blocks = [replace(b, attributes={**b.attributes, "time": 5.0 * k}) for k, b in enumerate(warm)]
    tried = [x.attribute for x in courses._courses(Problem(Toy(), blocks))]
    assert tried == ["", "", "", "temperature"]


def test_what_says_how_a_block_is_driven_is_the_same_for_its_repeats():
    """As measured it may differ a little, and goes with the scatter since it is made of that."""
    blocks = [replace(b, units={"temperature": "K"}) for b in at_temperatures(0, 0.02)]
    problem = Problem(Toy(), blocks)
    residual, jacobian = residual_and_jacobian(problem)
    assert find_drift(problem, residual, jacobian, SHARE) is None


@pytest.mark.parametrize("seed", range(6))
def test_an_attribute_that_nothing_goes_with_takes_nothing(seed: int):
    problem = Problem(Toy(), at_temperatures(seed, 0.0))
    residual, jacobian = residual_and_jacobian(problem)
    assert find_drift(problem, residual, jacobian, SHARE) is None
    assert without_courses(problem, residual, SHARE)[1] == {}


@pytest.mark.parametrize("seed", range(6))
def test_scatter_of_a_parameter_is_no_drift(seed):
    rng = np.random.default_rng(seed)
    scatter = rng.normal(0.5, 0.05, 24)
    problem = Problem(Toy(), session(seed, lambda x: scatter[round(24 * x)]))
    assert find_drift(problem, *residual_and_jacobian(problem), SHARE) is None


def test_two_repeats_far_from_all_others_are_no_course():
    """One early, one late, of one condition: an analysis of variance takes scatter for Gaussian."""
    for seed in range(20):
        stiffness = 0.5 + 0.02 * np.random.default_rng(seed).standard_normal(39)
        stiffness[[2, 38]] += 0.2, -0.2
        problem = Problem(Toy(), session(seed, lambda x, c=stiffness: c[round(39 * x)], n=39))
        residual, jacobian = residual_and_jacobian(problem)
        assert find_drift(problem, residual, jacobian, SHARE) is None
        assert without_courses(problem, residual, SHARE)[1] == {}


def test_a_gain_that_wanders_takes_neighbours_along_and_is_seldom_a_course():
    """Taken for independent, these 30 sessions had 12 courses."""
    found = 0
    for seed in range(30):
        rng, level = np.random.default_rng(seed), [0.0]
        for x in rng.normal(0.0, 0.06, 39):
            level.append(0.8 * level[-1] + x)
        problem = Problem(Toy(), session(seed, lambda x, c=level: 0.5 + c[round(39 * x)], n=39))
        residual, jacobian = residual_and_jacobian(problem)
        found += find_drift(problem, residual, jacobian, SHARE) is not None
        found += without_courses(problem, residual, SHARE)[1] != {}
    assert found <= 1


def repeated(level_of, n):
    """Repeats of one motion, whose force also has a dry part that is no parameter's."""
    level = np.array([level_of(i / n) for i in range(n)])
    blocks = session(1, lambda _: 0.5, 3 * n)[::3]
    out = []
    for block, fc in zip(blocks, level, strict=True):
        f, x = block.outputs["f"], block.outputs["x"]
        dry = fc * np.sign(np.cos(x.t - x.t[0]))
        outputs = dict(block.outputs) | {"f": replace(f, y=f.y + dry)}
        out.append(replace(block, condition="one", outputs=outputs))
    problem = Problem(Toy(), out)
    return problem, problem.y - problem.predict(problem.nominal(), ())


@pytest.mark.parametrize("n", [9, 12, 24])
def test_a_course_leaves_the_floor_that_there_is_without_it(n):
    """However few repeats there are: it takes a degree of freedom of every sample with it."""
    floors = []
    for c_of in (lambda _: 0.5, lambda x: 0.5 + 0.3 * x):
        problem = Problem(Toy(), session(1, c_of, n=n))
        residual, _ = residual_and_jacobian(problem)
        left, names = without_courses(problem, residual, SHARE)
        floors.append(NoiseModel.by(problem, left, Options()).floor[1])
    assert names == {"f": ""}
    assert floors[1] == pytest.approx(floors[0], rel=0.1)


def test_what_changes_without_being_a_parameter_is_a_gap():
    problem, residual = repeated(lambda x: 0.4 * np.exp(-x / 0.3), 7)
    left, names = without_courses(problem, residual, SHARE)
    assert names == {"f": ""}
    floor = [NoiseModel.by(problem, r, Options()).floor[1] for r in (residual, left)]
    assert floor[1] < 0.3 * floor[0]
    own = problem.obs_of != 1
    assert np.array_equal(left[own], residual[own])


def test_repeats_that_differ_in_no_order_are_scatter():
    rng = np.random.default_rng(3)
    for n in rng.integers(4, 12, 40):
        problem, residual = repeated(lambda _: rng.normal(0.0, 0.2), n)
        left, names = without_courses(problem, residual, SHARE)
        assert names == {} and left is residual


@pytest.mark.long
def test_drift_that_no_effect_explains_is_unknown():
    diagnosis = diagnose(Toy(), session(2, lambda x: 0.5 + 0.25 * x))
    assert diagnosis.verdict == "unknown", diagnosis.sentence
    assert any("drifted over the session" in w for w in diagnosis.warnings)


def test_repeats_with_another_history_are_no_repeats():
    blocks = recordings(3, 24)
    changed = []
    for i, b in enumerate(blocks):  # every second round comes after something that leaves an offset
        second = i // 3 % 2 == 1
        f = b.outputs["f"]
        outputs = dict(b.outputs) | {"f": Signal(f.t, f.y + 0.2 * second, f.unit)}
        changed.append(
            replace(b, outputs=outputs, history="after a pause" if second else "at once")
        )
    plain, with_history = (
        Problem(Toy(), [replace(b, history="") for b in changed]),
        Problem(Toy(), changed),
    )
    floors = [
        NoiseModel.by(p, p.y - p.predict(p.nominal(), ()), Options()).floor[1]
        for p in (plain, with_history)
    ]
    assert floors[1] < 0.5 * floors[0]


@pytest.mark.parametrize("history", [str, lambda i: str(i // 3 % 2)])
def test_histories_that_do_not_show_change_no_floor(history):
    blocks = recordings(3, 24)
    with_history = [replace(b, history=history(i)) for i, b in enumerate(blocks)]
    floors = []
    for chosen in (blocks, with_history):
        problem = Problem(Toy(), chosen)
        floors.append(
            NoiseModel.by(
                problem, problem.y - problem.predict(problem.nominal(), ()), Options()
            ).floor
        )
    assert np.array_equal(*floors)


def test_a_condition_that_scatters_more_than_others_is_no_history():
    """One condition scatters widely and never comes after the same thing twice but once: an
    analysis of variance over all conditions would take its scatter for what came before."""
    shown = 0
    for seed in range(20):
        wide = np.random.default_rng(seed)
        blocks = []
        for i, b in enumerate(recordings(seed, 24)):
            f, odd = b.outputs["f"], i % 3 == 0
            outputs = dict(b.outputs) | {"f": Signal(f.t, f.y + odd * wide.normal(0, 0.2), f.unit)}
            history = str(max(i // 3, 1)) if odd else str(i // 3 % 2)
            blocks.append(replace(b, outputs=outputs, history=history))
        problem = Problem(Toy(), blocks)
        cells = [c for c in problem.cells if problem.observables[c.observable].name == "f"]
        residual = problem.y - problem.predict(problem.nominal(), ())
        shown += [len(g.cells) for g in repeats(problem, cells, residual)] != [8, 8, 8]
    assert shown == 0


def test_an_event_with_two_repeats_hides_no_drift_of_a_long_signal():
    """Of two repeats two courses explain all: such an observable must not set what chance brings
    for those with many.
    """
    blocks = session(1, lambda x: 0.5 + 0.2 * x)
    few = [replace(b, events=b.events if i in (0, 3) else {}) for i, b in enumerate(blocks)]
    problem = Problem(Toy(), few)
    residual, jacobian = residual_and_jacobian(problem)
    jacobian[problem.obs_of == 2] = 1.0  # so that the event moves with each parameter
    residual[problem.obs_of == 2] += np.arange(2.0)
    drift = find_drift(problem, residual, jacobian, SHARE)
    assert drift is not None
    assert drift.parameter == "c"


class Beginning(Toy):
    """A twin that leaves its first two samples out, as the tutorial says where a state is known
    badly.
    """

    def simulate(self, blocks, values, effects):
        out = super().simulate(blocks, values, effects)
        for prediction in out:
            prediction["f"] = np.r_[np.full(2, np.nan), prediction["f"][2:]]
        return out


class Geared(Toy):
    """The toy whose drive turns its force into a speed, too."""

    observables = (*Toy.observables, Observable("w", "force", "w", "m/s"))
    parameters = (*Toy.parameters, Parameter("g", 1.0, 0.2, 5.0, "", "motion", sd=0.2, log=True))

    def simulate(self, blocks, values, effects):
        out = super().simulate(blocks, values, effects)
        for b, prediction in zip(blocks, out, strict=True):
            prediction["w"] = values["g"] * b.inputs["u"].y
            prediction["f"] = values["g"] * prediction["f"]
        return out


def test_what_drifts_moves_all_that_hangs_on_it():
    """A gain of force and speed would explain the force's drift as well as the stiffness does, and
    set repeats of the speed apart.
    """
    rng, blocks = np.random.default_rng(0), []
    for b in session(1, lambda x: 0.5 + 0.3 * x):
        u = b.inputs["u"]
        speed = Signal(u.t, u.y + 0.02 * rng.standard_normal(u.y.size), "m/s")
        blocks.append(replace(b, outputs={**b.outputs, "w": speed}))
    problem = Problem(Geared(), blocks)
    residual, jacobian = residual_and_jacobian(problem)
    drift = find_drift(problem, residual, jacobian, SHARE)
    assert drift is not None and drift.parameter == "c"
    only = find_drift(problem, residual, np.where([[1, 0, 1]], jacobian, 0.0), SHARE)
    assert only is not None and only.parameter == "g"
    moved = [np.any(only.residual[problem.obs_of == o]) for o in range(4)]
    assert moved == [False, True, False, False]


def test_a_sample_that_is_not_predicted_hides_no_drift():
    problem = Problem(Beginning(), session(1, lambda x: 0.5 + 0.3 * x))
    drift = find_drift(problem, *residual_and_jacobian(problem), SHARE)
    assert drift is not None and drift.parameter == "c"


def without_samples(signals):
    lost = np.s_[200:220]
    kept = {n: (np.delete(s.t, lost), np.delete(s.y, lost), s.unit) for n, s in signals.items()}
    return {n: Signal(*parts) for n, parts in kept.items()}


def test_samples_that_were_lost_make_no_drift():
    """By their number, those behind lie beside others of the repeats, and a gap that all have in
    common seems to change.
    """
    steady = session(1, lambda _: 0.5)
    blocks = []
    for i, b in enumerate(steady):
        x, f = b.outputs["x"], b.outputs["f"]
        common = 0.3 * np.sign(np.cos((1 + i % 3) * (x.t - x.t[0])))
        outputs = {"x": x, "f": Signal(f.t, f.y + common, f.unit)}
        late = i >= len(steady) // 2
        made = replace(b, outputs=outputs)
        if late:
            inputs = without_samples(b.inputs)
            made = replace(b, inputs=inputs, outputs=without_samples(outputs))
        blocks.append(made)
    problem = Problem(Toy(), blocks)
    residual, jacobian = residual_and_jacobian(problem)
    assert find_drift(problem, residual, jacobian, SHARE) is None
    assert without_courses(problem, residual, SHARE)[1] == {}
