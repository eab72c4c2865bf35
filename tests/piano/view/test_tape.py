"""What the page is drawn from: the tape, the postures and the player, without a browser."""

from __future__ import annotations

import io
import json
import sys
import webbrowser
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from view_cases import DIP, NOTE, recording

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cli.graph.view import open_in_browser
from pianobot_ros.piano.gap.diagnosis import live
from pianobot_ros.piano.gap.diagnosis.live import StageMap
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin
from pianobot_ros.piano.view.replay import Player, timeline
from pianobot_ros.piano.view.scene.cell_view import build_solver_model, magnified, relative
from pianobot_ros.piano.view.scene.posture import Measured, Posture, PostureSolver
from pianobot_ros.piano.view.tape.from_bag import load_tape, tape_of
from pianobot_ros.piano.view.tape.stage_history import fill_stages
from pianobot_ros.piano.view.tape.tape import Tape


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def pose(depth: float) -> np.ndarray:
    p = wrist_pose({"middle": NOTE}).raised(-depth)
    return np.array([*p.position, *p.rotation.as_rotvec()])


@pytest.fixture(scope="module")
def solver() -> PostureSolver:
    return PostureSolver(build_solver_model())


@pytest.mark.parametrize("depth", [0.004, 0.009, 0.012])
@pytest.mark.parametrize("sticks", [True, False])
def test_estimated_fingers_are_where_the_twin_has_them_at_rest(
    solver: PostureSolver, depth: float, sticks: bool
) -> None:
    """The estimate knows no friction at the tip, which holds as much of the force as it happened to
    when the tip came to rest; without it the estimate is the twin's.
    """
    twin = CellTwin(pose=pose(depth))
    if not sticks:
        twin.cell.model.pair_friction[:, :2] = 1e-5
    twin.command_vacuum({"middle": -5e4})
    samples = twin.step(2500)  # 1 s: at rest
    key = twin.cell.notes.index(NOTE)
    keys = dict(zip(twin.cell.notes, samples.angle[-1].tolist(), strict=True))
    found = solver.solve(Measured(pose(depth), pressure=np.array([0.0, 0.0, -5e4]), keys=keys))
    tip = twin.data.geom("middle_tip").xpos - [0, 0, twin.cell.hand.fingers["middle"].radius]
    assert found.tip == pytest.approx(tip, abs=1e-3)
    if not sticks:
        assert found.force == pytest.approx(samples.force[-1, key], rel=1e-3)
    assert not found.measured
    # A key without an encoder gives way as far as the twin's does.
    blind = solver.solve(Measured(pose(depth), pressure=np.array([0.0, 0.0, -5e4])))
    assert blind.qpos[twin.cell.key_qpos[key]] == pytest.approx(keys[NOTE], abs=0.008)


def test_hand_is_where_the_wrist_was_measured_and_force_is_the_sensors(
    solver: PostureSolver,
) -> None:
    keys = dict.fromkeys(keyboard().notes, 0.0)
    free = solver.solve(Measured(pose(-0.03), keys=keys, force=0.0, force_note=NOTE))
    assert free.xpos[solver.model.body("wrist").id] == pytest.approx(pose(-0.03)[:3], abs=1e-6)
    assert (free.force, free.measured) == (0.0, True)
    held = solver.solve(Measured(pose(0.01), keys=keys | {NOTE: DIP}, force=2.5, force_note=NOTE))
    assert (held.force, held.measured) == (2.5, True)
    joints = free.qpos[:6] + 0.01
    moved = solver.solve(Measured(pose(-0.03), joints=joints, keys=keys))
    assert moved.qpos[:6] == pytest.approx(joints)
    assert moved.xpos[solver.model.body("wrist").id] == pytest.approx(pose(-0.03)[:3], abs=1e-6)
    twice = magnified(free, held, 2.0)
    wrist = solver.model.body("wrist").id
    assert twice.xpos[wrist] - free.xpos[wrist] == pytest.approx([0, 0, -0.08], abs=1e-6)


def test_bodies_are_placed_in_the_frames_of_their_parents() -> None:
    random = np.random.default_rng(0)
    turns = Rotation.random(5, rng=random)
    places = random.normal(size=(5, 3))
    posture = Posture(np.zeros(1), places, turns.as_quat(scalar_first=True), places[0], 0.0, True)
    bodies, parents = np.array([1, 2, 4]), np.array([0, 1, 2])
    turn, place = relative(posture, bodies, parents)
    for i, (body, parent) in enumerate(zip(bodies, parents, strict=True)):
        back = turns[parent].inv()
        assert place[i] == pytest.approx(back.apply(places[body] - places[parent]))
        difference = back * turns[body] * Rotation.from_quat(turn[i], scalar_first=True).inv()
        assert difference.magnitude() == pytest.approx(0.0, abs=1e-9)


def test_tape_is_read_as_of_a_moment() -> None:
    tape = tape_of(recording(3, silent=(2.0, 3.2)))
    assert [len(tape.until(t)[0]) for t in (0.5, 1.7, 9.0)] == [0, 1, 3]
    assert tape.sounding("real", 0.3) == frozenset()
    on = tape.rows[1].real.onset
    assert tape.sounding("real", on + 0.01) == {NOTE}
    assert tape.silent_since("real", "fsr", 1.9) is None
    assert tape.silent_since("real", "fsr", 2.8) == pytest.approx(2.0, abs=0.01)
    assert tape.silent_since("real", "fsr", 3.5) is None
    assert tape.silent_since("real", "nothing", 1.0) == -np.inf
    assert "/real/fsr silent for 1.2 s" in [f.text for f in tape.faults]
    time, value = tape.window("real/wrist/state.position", 1.0, 2.0)
    assert value.shape == (time.size, 3)
    assert 1.0 <= time[0] <= time[-1] <= 2.0


def test_live_tape_forgets_what_is_old() -> None:
    tape = Tape(memory=2.0)
    for start in np.arange(0.0, 30.0, 0.5):
        time = start + np.arange(0.0, 0.5, 0.01)
        tape.add("real/fsr.force", time, np.sin(time))
    assert tape.window("real/fsr.force", 0.0, 27.0)[0].size == 0
    assert tape.latest("real/fsr.force", 100.0)[0] == pytest.approx(29.99)


def test_bag_with_its_diagnosis_becomes_a_tape(tmp_path) -> None:
    bag = write_bag(recording(3, late=0.02), tmp_path / "bag")
    document = {
        "verdict": "effect",
        "sentence": "Missing effect: wrist_delay.",
        "candidates": [],
        "stages": [{"name": "wrist", "gap": 7.5}, {"name": "key", "gap": None}],
    }
    (tmp_path / "diagnosis.json").write_text(json.dumps(document))
    tape, (start, end), _ = load_tape(bag)
    assert start == pytest.approx(0.0, abs=0.01)
    assert end > 4.0
    assert tape.verdicts[0][1]["sentence"] == document["sentence"]
    assert tape.stages[0].gaps["wrist"] == 7.5
    rows = tape.until(end)[0]
    assert [r.condition for r in rows] == ["soft"] * 3
    assert rows[0].real.onset - rows[0].sim.onset == pytest.approx(0.02, abs=0.005)
    assert rows[0].err == pytest.approx(0.1 * 0.8, abs=0.02)
    (tmp_path / "diagnosis.json").write_text("[]")
    with pytest.raises(RecordingError, match="no verdict"):
        load_tape(bag)


def test_player_stops_at_the_end_and_timeline_marks_strikes_and_faults() -> None:
    player = Player(1.0, 3.0)
    assert player.advance(5.0) == 1.0
    player.playing, player.speed = True, 2.0
    assert player.advance(0.5) == 2.0
    assert player.advance(5.0) == 3.0
    assert not player.playing
    player.seek(-1.0)
    assert player.position == 1.0
    tape = tape_of(replace(recording(3, silent=(2.0, 3.2)), warnings=("half a chunk left out",)))
    tape.rows[2] = replace(tape.rows[2], adopted=("wrist_delay",))
    text = timeline(tape, 0.0, 5.0, 2.0)
    assert text.count("<title>strike") == 3
    assert "silent for 1.2 s" in text and "2 faults below" in text
    assert text.count("the twin adopted wrist_delay") == 1
    assert "half a chunk left out" in text


def test_a_strike_that_was_not_played_as_told_is_not_compared() -> None:
    whole = recording(3)
    second = whole.strikes[1]
    spoilt = replace(whole, refusals=((second.start + 0.1, second.start + 0.2, "/command/wrist"),))
    tape = tape_of(spoilt)
    rows = tape.rows
    assert [np.isfinite(row.err) for row in rows] == [True, False, True]
    assert rows[1].real is not None and rows[1].sim is not None
    text = timeline(tape, 0.0, 5.0, 2.0)
    assert text.count("not comparable") == 1 and "not sounded" not in text


def test_gap_by_stage_is_filled_in_strike_by_strike(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def stage_map(some: Recording) -> StageMap | str:
        seen.append(some)
        last = some.strikes[-1].index
        phases = {"rows": ["wrist"], "columns": ["down"], "values": [[float(last)]]}
        map_ = StageMap((("wrist", float(last), 1.0),), len(some.strikes), "", phases)
        return "no repeats" if last == 3 else map_

    monkeypatch.setattr(live, "stage_map", stage_map)
    whole = recording(12, late=0.02)
    tape = tape_of(whole)
    fill_stages(whole, tape)
    assert [s.strike for s in tape.stages] == [2, 3, 5, 6, 7, 8, 9, 10, 11, 12]
    assert [s.gaps["wrist"] for s in tape.stages] == [s.strike - 1.0 for s in tape.stages]
    assert tape.stages[-1].table.values[0, 0] == 11.0
    assert [len(some.strikes) for some in seen[-2:]] == [8, 8]
    assert not any(name.startswith("sim/") for name in seen[-1].signals)
    start, end = seen[-1].strikes[0].start, seen[-1].strikes[-1].end
    time = seen[-1].signals["real/wrist/state.position"].time
    assert start - 1.3 < time[0] < start and time[-1] <= end + 1.3
    # One who has seen enough ends it.
    tape.stages = []
    fill_stages(whole, tape, lambda: len(tape.stages) < 3)
    assert len(tape.stages) == 3


def test_browser_is_opened_only_before_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys, "stdout", Terminal())
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    open_in_browser("http://127.0.0.1:1")
    assert not opened
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    open_in_browser("http://127.0.0.1:2")
    monkeypatch.setattr(sys, "stdout", io.StringIO())  # nobody reads what goes into a file
    open_in_browser("http://127.0.0.1:3")
    assert opened == ["http://127.0.0.1:2"]
