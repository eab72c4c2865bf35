from __future__ import annotations

import numpy as np
import pytest
from action_strategies import actions, states
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from pianobot_ros.cell.errors import ConfigError, PianobotError
from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.hybrid import propagate, simulator
from pianobot_ros.piano.action.hybrid.action_model import PARTS, build_model
from pianobot_ros.piano.action.hybrid.elements import HAMMER, HAMMER_VELOCITY, KEY, KEY_VELOCITY
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Simulator, simulate
from pianobot_ros.piano.action.results.features import step_features, step_response

SILENCE = ForceProfile.step(0.0)
START = frozenset({"jack"})
FIG8 = {
    "a": ("ACCELERATION", "FREE FLIGHT"),
    "b": ("FREE FLIGHT", "ACCELERATION"),
    "c": ("FREE FLIGHT", "RAIL STOP"),
    "d": ("RAIL STOP", "FREE FLIGHT"),
    "e": ("RAIL STOP", "REPETITION"),
    "f": ("REPETITION", "RAIL STOP"),
    "g": ("REPETITION", "ACCELERATION"),
    "h": ("ACCELERATION", "REPETITION"),
}


def integrate(
    p: ActionParameters, force: float, start: np.ndarray, end: float
) -> tuple[list[float], np.ndarray]:
    """Fig. 8 and Table 3 written down independently, with scipy's event location: event times and
    final state.
    """
    h, r = p.hammer, p.front_rail

    def coupler(_t: float, y: np.ndarray, *_: object) -> float:
        return float(h.coupler_stiffness * (y[0] - y[2]) + h.coupler_damping * (y[1] - y[3]))

    def rail(_t: float, y: np.ndarray, *_: object) -> float:
        return float(y[0] - p.key.dip)

    def field(t: float, y: np.ndarray, on: bool, down: bool) -> list[float]:
        fc = coupler(t, y) if on else 0.0
        fr = r.stiffness * rail(t, y) + r.damping * y[1] if down else 0.0
        own = p.moving_damping * y[1] + p.armature.stiffness * (y[0] - p.initial_state.flexure_home)
        return [
            y[1],
            (force - own - fc - fr) / p.moving_mass,
            y[3],
            (fc - h.bushing_damping * y[3] - h.weight) / h.mass,
        ]

    t, y, on, down, times = 0.0, start.copy(), True, False, []
    while len(times) < 100:
        coupler.terminal = rail.terminal = True  # type: ignore[attr-defined]
        coupler.direction, rail.direction = (-1 if on else 1), (-1 if down else 1)  # type: ignore[attr-defined]
        run = solve_ivp(
            field,
            (t, end),
            y,
            "DOP853",
            args=(on, down),
            events=[coupler, rail],
            rtol=1e-11,
            atol=1e-13,
        )
        t, y = float(run.t[-1]), run.y[:, -1]
        if run.status == 0:
            return times, y
        on, down = (not on, down) if len(run.t_events[0]) else (on, not down)
        times.append(t)
        # Past the root, or its rounding would be taken for the next event.
        y = solve_ivp(field, (t, t + 1e-7), y, args=(on, down), rtol=1e-11, atol=1e-13).y[:, -1]
        t += 1e-7
    raise AssertionError("more than 100 events")


@given(actions(), st.floats(2.5, 12.0))
@fewer(0.12)
def test_exact_reference_agrees_with_an_independent_integration(
    p: ActionParameters, force: float
) -> None:
    path = simulate(build_model(p), ForceProfile.step(force), 0.3)
    times, final = integrate(p, force, path.segments[0].state[:4], 0.3)
    assert [e.time for e in path.events] == pytest.approx(times, abs=1e-7)
    z, _ = path.states(np.array([0.3]))
    assert z[0, :4] == pytest.approx(final, rel=1e-5, abs=1e-8)


@given(actions(), states(), st.sampled_from([frozenset(), PARTS, PARTS - {"repetition_lever"}]))
@fewer(0.4)
@pytest.mark.long
def test_energy_never_grows_in_free_motion(
    p: ActionParameters, state: np.ndarray, parts: frozenset[str]
) -> None:
    path = Simulator(build_model(p, parts)).run(SILENCE, 0.4, start=(START, state))
    energy = path.sample(2e-4).energy
    scale = max(1e-6, float(np.abs(energy).max()))
    assert np.all(np.diff(energy) <= 1e-9 * scale)


@given(actions(), states(), st.floats(0.0, 12.0))
@fewer(0.4)
def test_modes_are_consistent_with_table_three(
    p: ActionParameters, state: np.ndarray, force: float
) -> None:
    model = build_model(p)
    path = Simulator(model).run(ForceProfile.step(force), 0.4, start=(START, state))
    for event in path.events:
        if event.letter:
            before, after = FIG8[event.letter]
            assert simulator.mode_name(event.before) == before
            assert simulator.mode_name(event.after) == after
    coupler, rail = model.elements["coupler"], model.elements["front_rail"]
    z, modes = path.states(np.linspace(0.0, 0.4, 1501))
    for row, mode in zip(z, modes, strict=True):
        f, depth = row @ coupler.force, row @ rail.stretch
        assert f >= -1e-6 if "coupler" in mode else f <= 1e-6
        assert depth >= -1e-9 if "front_rail" in mode else depth <= 1e-9


@given(actions(), states(), st.floats(0.0, 12.0))
@fewer(0.12)
def test_position_and_velocity_are_continuous_and_integrate(
    p: ActionParameters, state: np.ndarray, force: float
) -> None:
    path = Simulator(build_model(p, PARTS)).run(
        ForceProfile.step(force), 0.15, start=(START, state)
    )
    for one, two in zip(path.segments, path.segments[1:], strict=False):
        assert one.stop == two.start
        reached = path.model.propagator(one.mode).advance(one.state, one.stop - one.start)
        assert reached[:4] == pytest.approx(two.state[:4], rel=1e-9, abs=1e-12)
    h = path.sample(2e-5)
    for position, velocity in ((h.key, h.key_velocity), (h.hammer, h.hammer_velocity)):
        way = np.concatenate([[0.0], np.cumsum((velocity[1:] + velocity[:-1]) / 2)]) * 2e-5
        assert position - position[0] == pytest.approx(way, abs=5e-6)


def test_events_do_not_depend_on_the_bracketing_grid(
    parameters: ActionParameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    profile = ForceProfile.steps([(0.0, 5.0), (0.15, 1.5), (0.23, 5.0), (0.37, 0.0)])
    normal = [
        (e.rule, e.time) for e in simulate(build_model(parameters, PARTS), profile, 0.5).events
    ]
    monkeypatch.setattr(propagate, "GRID", 1.3e-5)
    fine = [(e.rule, e.time) for e in simulate(build_model(parameters, PARTS), profile, 0.5).events]
    assert [r for r, _ in normal] == [r for r, _ in fine]
    assert [t for _, t in normal] == pytest.approx([t for _, t in fine], abs=1e-9)


def test_a_touch_shorter_than_the_grid_is_found(parameters: ActionParameters) -> None:
    """The key grazes the rail by a hair's breadth between two grid points."""
    press = ForceProfile.step(1.5)
    top = float(simulate(build_model(parameters), press, 0.3).sample(1e-6).key.max())
    assert top < parameters.key.dip, "the press must not reach the rail"
    path = simulate(build_model(parameters.vary("key", dip=top - 1e-10)), press, 0.3)
    assert [e.rule for e in path.events][:2] == ["bottom", "lift"]
    assert path.events[1].time - path.events[0].time < propagate.GRID


@given(actions(), states(), st.floats(1e-6, 0.3))
@fewer(0.3)
def test_propagation_is_the_matrix_exponential(
    p: ActionParameters, state: np.ndarray, time: float
) -> None:
    model = build_model(p, PARTS)
    for mode in ({"jack", "coupler"}, {"string", "front_rail"}, {"check", "back_rail"}):
        propagator = model.propagator(frozenset(mode))
        exact = expm(propagator.a * time) @ state
        assert propagator.advance(state, time) == pytest.approx(
            exact, rel=1e-7, abs=1e-9 * np.abs(exact).max()
        )


def test_step_has_the_papers_features(parameters: ActionParameters) -> None:
    features = step_features(step_response(parameters))
    assert features.bottoms_first, "Fig. 9: the key bottoms before the hammer flies free"
    assert features.modes == ("ACCELERATION", "REPETITION", "RAIL STOP", "REPETITION")
    assert features.leaves < features.bottoms + 0.01
    assert 0.0002 < features.backdrive < 0.002
    assert features.initial_peak > features.landing_excursion > 0.1


def test_step_matches_an_earlier_study(parameters: ActionParameters) -> None:
    """An earlier independent ODE, started from 0 at rest with m_H g / 5, bottomed at 60.5, left at
    66 and landed at 205 ms.
    """
    features = step_features(step_response(parameters.vary("initial_state", start=1.0)))
    assert features.bottoms == pytest.approx(0.0605, abs=5e-4)
    assert features.leaves == pytest.approx(0.066, abs=5e-4)
    assert features.lands == pytest.approx(0.205, abs=1e-3)


def test_landing_as_late_as_the_papers_needs_a_lighter_hammer(parameters: ActionParameters) -> None:
    weight = parameters.hammer.mass * 9.81
    lands = [
        step_features(step_response(parameters.vary("hammer", weight=s * weight), 1.5)).lands
        for s in (0.2, 0.08, 0.06)
    ]
    assert lands[0] < 0.25
    assert 0.37 < lands[1] < 0.45 < lands[2]


def test_rest_is_rest(parameters: ActionParameters) -> None:
    for parts in (frozenset[str](), PARTS):
        h = simulate(build_model(parameters, parts), SILENCE, 0.2).sample(1e-3)
        assert np.ptp(h.key) < 1e-12
        assert np.ptp(h.hammer) < 1e-12


def test_sampling_does_not_depend_on_the_grid_asked_for(parameters: ActionParameters) -> None:
    path = step_response(parameters, 0.4)
    times = np.sort(np.random.default_rng(0).uniform(0.0, 0.4, 200))
    scattered, _ = path.states(times)
    for time, z in zip(times, scattered, strict=True):
        assert path.states(np.array([time]))[0][0] == pytest.approx(z, rel=1e-9, abs=1e-12)
    columns = [KEY, KEY_VELOCITY, HAMMER, HAMMER_VELOCITY]
    even = path.sample(0.1)
    direct, _ = path.states(even.time)
    assert np.stack(
        [even.key, even.key_velocity, even.hammer, even.hammer_velocity], 1
    ) == pytest.approx(direct[:, columns])


def test_profiles_ramp_jump_and_refuse_disorder() -> None:
    assert ForceProfile.step(3.0, at=0.1).pieces(0.5) == [
        (0.0, 0.1, 0.0, 0.0),
        (0.1, 0.5, 3.0, 0.0),
    ]
    assert ForceProfile((0.0, 0.2), (0.0, 4.0)).pieces(0.1) == [(0.0, 0.1, 0.0, 20.0)]
    stepped = ForceProfile.steps([(0.0, 5.0), (0.1, 1.0)]).pieces(0.2)
    assert stepped == [(0.0, 0.1, 5.0, 0.0), (0.1, 0.2, 1.0, 0.0)]
    with pytest.raises(ConfigError, match="fall back"):
        ForceProfile((0.2, 0.1), (0.0, 1.0))
    with pytest.raises(ConfigError, match="as many times"):
        ForceProfile((), ())


def test_errors_say_what_to_do(parameters: ActionParameters) -> None:
    with pytest.raises(ConfigError, match="unknown part 'let-off'"):
        build_model(parameters, {"let-off"})
    with pytest.raises(ConfigError, match="let_off"):
        build_model(parameters, {"back_rail", "backcheck"})
    with pytest.raises(ConfigError, match="back_rail"):
        build_model(parameters, {"let_off"})
    with pytest.raises(ConfigError, match="after 0 s"):
        simulate(build_model(parameters), SILENCE, 0.0)
    with pytest.raises(PianobotError, match="press harder"):
        step_features(simulate(build_model(parameters), SILENCE, 0.1))
    with pytest.raises(PianobotError, match="longer"):
        step_features(step_response(parameters, 0.1))
