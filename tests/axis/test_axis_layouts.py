"""Layouts of published logs that no reader of ours had seen: episodes in JSON, a file for the time
stamps, two encoders a joint.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from laboratory import Q, T, U, table
from scipy.io import savemat

from pianobot_ros.axis.diagnosis.joint import diagnose_logs
from pianobot_ros.axis.diagnosis.robot import diagnose_robot, logs_by_joint
from pianobot_ros.axis.reading import Request, read_recordings
from pianobot_ros.gap import GapError

TIME = np.arange(600) * 0.01
ANGLES = np.stack([np.sin((1 + 0.3 * k) * TIME + k) for k in range(3)], axis=1)


def test_runs_in_a_list_of_json_are_runs_of_their_own(tmp_path: Path) -> None:
    runs = [
        {
            "type": "sine",
            "actions": list(np.sin(w * TIME)),
            "sensor_data": list(0.7 * np.sin(w * TIME - 0.4)),
        }
        for w in (2.0, 3.0, 5.0, 7.0)
    ]
    held = {"config": {"action_hz": 100, "limits": [-1, 1]}, "data": runs}
    (tmp_path / "servo.json").write_text(json.dumps(held))
    found = read_recordings([tmp_path / "servo.json"])
    assert len(found) == 4
    for w, recording in zip((2.0, 3.0, 5.0, 7.0), found, strict=True):
        (log,) = recording.joints.values()
        assert np.allclose(log.t, TIME)
        assert log.command is not None and np.allclose(log.command, np.sin(w * TIME))
        assert np.allclose(log.position, 0.7 * np.sin(w * TIME - 0.4))


@pytest.mark.parametrize("in_turn", [True, False])
def test_time_stamps_in_a_file_of_their_own(tmp_path: Path, in_turn: bool) -> None:
    slopes, pulls = np.gradient(ANGLES, TIME, axis=0), 3.0 * np.sin(ANGLES)
    np.savetxt(tmp_path / "run_time.txt", TIME)
    for name, values in (("positions", ANGLES), ("velocity", slopes), ("torques", pulls)):
        np.savetxt(tmp_path / f"run_{name}.txt", values.ravel() if in_turn else values)
    (found,) = read_recordings([tmp_path])
    assert len(found.joints) == 3
    for k, log in enumerate(found.joints.values()):
        assert np.allclose(log.position, ANGLES[:, k])
        assert log.effort is not None and np.allclose(log.effort, pulls[:, k])
        assert log.effort_unit == "Nm"


def test_of_two_encoders_that_which_moves_in_every_joint_is_taken(tmp_path: Path) -> None:
    angle = np.degrees(ANGLES).T
    second = np.where([[True], [False], [False]], angle, 0.0)
    held = {
        "time": TIME,
        "rec": {
            "act_pos_se_deg": second,
            "act_pos_mot_deg": angle,
            "ref_pos_deg": np.degrees(np.sin(TIME + np.arange(3)[:, None])),
            "act_torque_abs_nm": 2.0 * angle,
            "act_torque_rel_nm": angle,
            "act_vel_se_deg_per_s": second,
            "act_vel_mot_deg_per_s": np.gradient(angle, TIME, axis=1),
        },
    }
    savemat(tmp_path / "kuka.mat", held)
    (found,) = read_recordings([tmp_path / "kuka.mat"])
    assert list(found.joints) == ["0", "1", "2"]
    for k, log in enumerate(found.joints.values()):
        assert np.allclose(log.position, ANGLES[:, k])
        assert log.command is not None and log.effort is not None
        assert log.velocity is not None and np.ptp(log.velocity) > 1.0
    notes = next(iter(found.joints.values())).notes
    assert any("act_pos_se_deg" in note and "left out" in note for note in notes)


def test_what_is_measured_goes_before_what_is_filtered_or_modelled(tmp_path: Path) -> None:
    columns = {"time": TIME}
    for k in (0, 1):
        columns |= {f"pos_meas{k}": ANGLES[:, k], f"pos_filt{k}": 0.99 * ANGLES[:, k]}
        columns |= {f"tau_con{k}": 5 * ANGLES[:, k], f"tau_meas{k}": 2 * ANGLES[:, k]}
    rows = np.array(list(columns.values())).T
    path = tmp_path / "pendulum.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    (found,) = read_recordings([path])
    assert list(found.joints) == ["0", "1"]
    for k, log in enumerate(found.joints.values()):
        assert np.allclose(log.position, ANGLES[:, k])
        assert log.effort is not None and np.allclose(log.effort, 2 * ANGLES[:, k])


def test_a_cell_without_end_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "plc.txt"
    numbers = ", ".join(["0.000000"] * 30_000)
    path.write_text("".join(f"phi_{k} : ARRAY OF REAL := [{numbers}];\n" for k in range(6)))
    with pytest.raises(GapError) as refused:
        read_recordings([path])
    assert "\n" not in str(refused.value)


def test_runs_too_short_to_be_cut_are_left_out_beside_longer_ones(tmp_path: Path) -> None:
    runs = [
        {"actions": list(np.sin(3 * t)), "angle": list(0.9 * np.sin(3 * t - 0.2))}
        for t in (TIME[:40], TIME, TIME[:45], TIME + 1)
    ]
    (tmp_path / "servo.json").write_text(json.dumps({"dt": 0.01, "runs": runs}))
    logs = [log for r in read_recordings([tmp_path / "servo.json"]) for log in r.joints.values()]
    verdict = diagnose_logs(logs, budget=1)
    assert sum("too short" in w for w in verdict.warnings) == 1
    assert any("(and 1 more)" in w for w in verdict.warnings if "too short" in w)


@pytest.mark.parametrize("named", [False, True])
def test_objects_of_motors_in_each_line_of_json(tmp_path: Path, named: bool) -> None:
    """Forces of as many feet are no motors' efforts; a command counts while a gain follows it."""
    rows = []
    for k, (t, q) in enumerate(zip(TIME, ANGLES, strict=True)):
        gain = 0.0 if k < 150 else 40.0
        names = [{"name": f"{w} joint"} if named else {} for w in ("hip", "thigh", "calf")]
        state = [n | {"q": x, "tau_est": 0.1 * x} for n, x in zip(names, q, strict=True)]
        wanted = [n | {"q": x if gain else 2e9, "kp": gain} for n, x in zip(names, q, strict=True)]
        row = {"foot_force": [20, 21, 19, 22 + k % 3], "tick": 5000 + round(1000 * t)}
        rows.append(json.dumps(row | {"motor_state": state, "motor_cmd": wanted}))
    (tmp_path / "robot.jsonl").write_text("\n".join([*rows, rows[0][:40]]))
    (recording,) = read_recordings([tmp_path / "robot.jsonl"])
    assert list(recording.joints) == (["hip", "thigh", "calf"] if named else ["0", "1", "2"])
    assert any("1 of 601 lines are no JSON" in n for n in recording.notes)
    for k, log in enumerate(recording.joints.values()):
        assert np.allclose(log.t, TIME) and np.allclose(log.position, ANGLES[:, k])
        assert log.unit == "rad"  # a foot's force does not make a motor a linear one
        assert log.effort is not None and np.allclose(log.effort, 0.1 * ANGLES[:, k])
        assert log.command is not None and np.isnan(log.command[:150]).all()
        assert np.allclose(log.command[150:], ANGLES[150:, k])


def test_lists_of_joints_in_each_line_of_json_are_no_runs(tmp_path: Path) -> None:
    wide = np.hstack([ANGLES, -ANGLES])
    rows = [{"t": t, "q": list(q), "tau": list(2 * q)} for t, q in zip(TIME, wide, strict=True)]
    (tmp_path / "arm.jsonl").write_text("\n".join(map(json.dumps, rows)))
    (recording,) = read_recordings([tmp_path / "arm.jsonl"])
    for k, log in enumerate(recording.joints.values()):
        assert np.allclose(log.position, wide[:, k])


@pytest.mark.parametrize("axes", ["time first", "runs first", "as many runs as samples"])
def test_simulations_side_by_side_are_runs_of_their_own(tmp_path: Path, axes: str) -> None:
    """A torque that was applied is an effort; what lies above the joints, a body say, is none."""
    t = TIME[:80]
    count = t.size if axes == "as many runs as samples" else 5
    phases = np.random.default_rng(0).uniform(0, 6, (count, 1, 3))
    q = np.sin((1 + 0.3 * np.arange(3)) * t[:, None] + phases)
    arrays = {"joint_pos": q, "joint_pos_target": 1.1 * q, "applied_torque": 2 * q}
    arrays |= {"root_pos_w": q + 1, "reward": q[..., :1] ** 2}
    if axes != "runs first":
        arrays = {k: np.swapaxes(x, 0, 1) for k, x in arrays.items()}
    np.savez(tmp_path / "sims.npz", dt=0.01, joint_names=["a", "b", "c"], **arrays)
    found = read_recordings([tmp_path / "sims.npz"], Request(units={"position": "rad"}))
    assert len(found) == count
    for run, recording in enumerate(found):
        assert list(recording.joints) == ["a", "b", "c"]
        for k, log in enumerate(recording.joints.values()):
            assert np.allclose(log.position, q[run, :, k]) and np.allclose(log.t, t)
            assert log.command is not None and np.allclose(log.command, 1.1 * q[run, :, k])
            assert log.effort is not None and np.allclose(log.effort, 2 * q[run, :, k])


def test_arrays_of_runs_whose_time_nothing_tells_are_refused(tmp_path: Path) -> None:
    """Noise says nothing of time, but stamps do."""
    noise = np.random.default_rng(0).normal(size=(30, 40, 2))
    np.savez(tmp_path / "sims.npz", joint_pos=noise, joint_target=noise, dt=0.01)
    with pytest.raises(GapError, match="joint_pos has 30x40x2 numbers, and nothing tells which"):
        read_recordings([tmp_path / "sims.npz"])
    np.savez(tmp_path / "sims.npz", joint_pos=noise, joint_target=noise, time=TIME[:40])
    assert len(read_recordings([tmp_path / "sims.npz"])) == 30


def _demos(path: Path, actions: dict[str, np.ndarray]) -> Path:
    """A set of demonstrations as robomimic writes it: joints, a gripper and the end effector."""
    with h5py.File(path, "w") as file:
        for k, (name, action) in enumerate(actions.items()):
            angles = np.stack([np.sin((1 + 0.3 * j + 0.1 * k) * TIME + j) for j in range(3)], 1)
            group = file.create_group(f"data/{name}")
            group["actions"] = action
            group["states"] = np.column_stack([TIME, angles])
            group["obs/robot0_joint_pos"] = angles
            group["obs/robot0_joint_vel"] = np.gradient(angles, TIME, axis=0)
            group["obs/robot0_joint_pos_cos"] = np.cos(angles)
            group["obs/robot0_joint_pos_sin"] = np.sin(angles)
            group["obs/robot0_eef_pos"] = angles * 0.3
            group["obs/robot0_gripper_qpos"] = 0.02 * np.sign(angles[:, :2])
    return path


def test_actions_are_commands_in_all_runs_of_a_set_or_in_none(tmp_path: Path) -> None:
    strange = np.stack([np.sin(w * TIME) for w in (5.0, 7.0, 9.0)], axis=1)
    chance = strange.copy()
    chance[:, :2] = np.sin(TIME[:, None] * [1.1, 1.4] + [0.1, 1.1])
    path = _demos(tmp_path / "deltas.hdf5", {"a": strange, "b": chance, "c": strange})
    runs = read_recordings([path])
    assert [set(run.joints) for run in runs] == [{"0", "1", "2", "gripper 0", "gripper 1"}] * 3
    assert all(log.command is None for run in runs for log in run.joints.values())
    assert all(any("do not follow actions[0]" in n for n in run.notes) for run in runs)
    with pytest.raises(GapError, match="no joint has a command or an effort"):
        diagnose_robot(logs_by_joint(runs))
    leads = [
        np.sin(TIME[:, None] * (1 + 0.3 * np.arange(3) + 0.1 * k) + np.arange(3) + 0.1)
        for k in range(3)
    ]
    leads[1] = strange  # a hand held the arm
    runs = read_recordings([_demos(tmp_path / "angles.hdf5", dict(zip("abc", leads, strict=True)))])
    assert all(run.joints["0"].command is not None for run in runs)


def test_what_belongs_to_a_group_or_a_body_is_no_joint_s_name(tmp_path: Path) -> None:
    held = {"time": TIME, "observations/qpos": ANGLES, "action": np.sin(TIME[:, None] + 0.1)}
    held |= {"observations/root_pos_w": ANGLES, "observations/root_quat_w": ANGLES}
    held |= {"computed_torque": 3 * ANGLES, "applied_torque": 2 * ANGLES}
    with h5py.File(tmp_path / "episode.hdf5", "w") as file:
        for name, values in held.items():
            file[name] = values if name != "action" else np.repeat(values, 3, axis=1)
    (found,) = read_recordings([tmp_path / "episode.hdf5"])
    assert list(found.joints) == ["0", "1", "2"]
    for k, log in enumerate(found.joints.values()):
        assert log.effort is not None and np.allclose(log.effort, 2 * ANGLES[:, k])


def test_the_observed_and_measured_go_before_copies_and_what_was_computed(tmp_path: Path) -> None:
    held = {
        "action/joint_position": ANGLES + 0.1,
        "action/robot_state/joint_positions": np.roll(ANGLES, 1, axis=0),
        "observation/robot_state/joint_positions": ANGLES,
        "observation/robot_state/joint_torques_computed": 3 * ANGLES,
        "observation/robot_state/motor_torques_measured": 2 * ANGLES,
    }
    with h5py.File(tmp_path / "trajectory.h5", "w") as file:
        for name, values in ({"time": TIME} | held).items():
            file[name] = values
    (found,) = read_recordings([tmp_path / "trajectory.h5"])
    for k, log in enumerate(found.joints.values()):
        assert np.allclose(log.position, ANGLES[:, k])
        assert log.command is not None and log.effort is not None
        assert np.allclose(log.effort, 2 * ANGLES[:, k])
    (note,) = [n for n in found.notes if "left out beside others" in n]
    assert "action/robot_state/joint_positions[0]" in note and "torques_computed[0]" in note


@pytest.mark.parametrize("kind", ["angles", "steps", "speeds"])
def test_steps_and_speeds_are_no_commands_of_a_position(tmp_path: Path, kind: str) -> None:
    t = TIME[:, None] + 0.05 * np.arange(3)
    angles = np.sin(1.3 * t) + 0.5 * np.sin(2.9 * t + 1)
    steps = np.roll(angles, -1, axis=0) - angles
    steps[-1] = steps[-2]
    actions = {"angles": np.roll(angles, -4, axis=0), "steps": steps, "speeds": 100 * steps}
    held = {"time": TIME, "joint_pos": angles, "action": actions[kind]}
    np.savez(tmp_path / "demo.npz", **held)  # type: ignore[arg-type]
    (found,) = read_recordings([tmp_path / "demo.npz"])
    for log in found.joints.values():
        assert (log.command is not None) == (kind == "angles") and log.effort is None


def test_of_two_clocks_that_disagree_the_measured_one_is_taken(tmp_path: Path) -> None:
    """A counter of loops times what a loop should take halved the time: all rates were double."""
    real = np.cumsum(0.01 + 0.001 * np.random.default_rng(0).uniform(-1, 1, TIME.size))
    rows = np.column_stack([0.5 * TIME, real, ANGLES[:, 0] + 0.01, ANGLES[:, 0]])
    head = "timestamp,real_time,command,position"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=head, comments="", fmt="%.9g")
    (recording,) = read_recordings([tmp_path / "log.csv"])
    (log,) = recording.joints.values()
    assert log.t[-1] == pytest.approx(real[-1] - real[0])
    assert any("real_time is taken" in note for note in log.notes)


def test_a_second_clock_shifts_no_blocks(tmp_path: Path) -> None:
    """A computer's time in µs beside the controller's, in a table without headers."""
    speeds = np.gradient(ANGLES, TIME, axis=0)
    late = np.roll(ANGLES, -2, axis=0)[:-2]
    stamps = np.round(1.5e15 + 1e6 * TIME)[:, None]
    rows = np.hstack([TIME[:, None], stamps, ANGLES, speeds])[:-2]
    rows = np.hstack([rows, np.gradient(late, TIME[:-2], axis=0), late])
    np.savetxt(tmp_path / "log.txt", rows, fmt="%.17g")
    (recording,) = read_recordings([tmp_path / "log.txt"])
    assert len(recording.joints) == 3
    for k, log in enumerate(recording.joints.values()):
        assert np.allclose(log.position, ANGLES[:-2, k])
        assert log.command is not None and np.allclose(log.command, late[:, k])


def test_an_effort_that_is_named_leaves_the_rest_to_be_found(tmp_path: Path) -> None:
    q = np.sin(3 * TIME)
    held = {"t": TIME, "qg": q, "qm": np.interp(TIME - 0.02, TIME, q), "vir": np.cos(3 * TIME)}
    savemat(tmp_path / "log.mat", held)
    request = Request(columns={"effort": "vir"})
    (recording,) = read_recordings([tmp_path / "log.mat"], request)
    (log,) = recording.joints.values()
    assert log.effort is not None and log.command is not None
    assert np.allclose(log.position, held["qm"])


def test_a_load_with_a_sign_goes_before_a_current_without(tmp_path: Path) -> None:
    load = np.cos(3 * TIME)
    rows = np.column_stack([TIME, ANGLES[:, 0], np.abs(load), load])
    np.savetxt(
        tmp_path / "log.csv", rows, delimiter=",", header="t,position,current,load", comments=""
    )
    (recording,) = read_recordings([tmp_path / "log.csv"])
    (log,) = recording.joints.values()
    assert log.effort is not None and np.allclose(log.effort, load)
    assert any("never negative" in note for note in log.notes)


@pytest.mark.parametrize(
    "heads", ["时间(s),目标位置(mm),实际位置(mm)", "t,実位置[mm],指令位置[mm]"]
)
def test_words_of_another_language_are_told_by_who_follows_whom(tmp_path: Path, heads: str) -> None:
    q = 1e3 * np.interp(TIME - 0.03, TIME, np.sin(3 * TIME))
    pair = [1e3 * np.sin(3 * TIME), q] if "目标" in heads else [q, 1e3 * np.sin(3 * TIME)]
    rows = np.column_stack([TIME, *pair])
    np.savetxt(
        tmp_path / "log.csv", rows, delimiter=",", header=heads, comments="", encoding="utf-8"
    )
    (recording,) = read_recordings([tmp_path / "log.csv"])
    (log,) = recording.joints.values()
    assert log.command is not None and np.allclose(log.command, np.sin(3 * TIME))
    assert np.allclose(log.position, 1e-3 * q)


ARMS = ("left", "right")


def _rows(path: Path, head: str, row: Callable[[int, int], str]) -> Path:
    """A table with a row for each time and each of two robots."""
    lines = [head, *(f"{t:.3f},{row(k, a)}" for k, t in enumerate(T) for a in (0, 1))]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("told", ["arm", "robot_id"])
def test_rows_of_several_robots_are_theirs(tmp_path: Path, told: str) -> None:
    """Two robots whose rows come in turn are no one robot of coarse stamps."""
    name = ARMS if told == "arm" else ("1", "2")
    path = _rows(
        tmp_path / "a.csv",
        f"time,{told},q1,q1_cmd,q2,q2_cmd",
        lambda k, a: f"{name[a]},{Q[k] + a:.6f},{U[k] + a:.6f},{2 * Q[k] + a:.6f},{2 * U[k]:.6f}",
    )
    (run,) = read_recordings([path])
    assert list(run.joints) == [f"{robot} {joint}" for robot in name for joint in (1, 2)]
    for joint, log in run.joints.items():
        size, beside = int(joint[-1]), joint.startswith(name[1])
        assert np.allclose(log.position, size * Q + beside, atol=1e-5)
        assert np.allclose(log.t, T, atol=1e-3)


def test_rows_of_several_robots_and_joints_are_not_mixed(tmp_path: Path) -> None:
    lines = ["time,robot,joint,q,q_cmd"]
    for k, t in enumerate(T):
        lines += [
            f"{t:.3f},{'AB'[a]},{j},{j * Q[k] + a:.6f},{j * U[k] + a:.6f}"
            for a in (0, 1)
            for j in (1, 2)
        ]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (run,) = read_recordings([tmp_path / "a.csv"])
    assert list(run.joints) == ["A 1", "A 2", "B 1", "B 2"]
    assert np.allclose(run.joints["B 2"].position, 2 * Q + 1, atol=1e-5)


@pytest.mark.parametrize("told", ["episode_id", "env_id", "trial_id"])
def test_the_number_of_a_run_may_be_called_its_id(tmp_path: Path, told: str) -> None:
    path = _rows(
        tmp_path / "a.csv", f"time,{told},q,q_cmd", lambda k, a: f"{a},{Q[k] + a},{U[k] + a}"
    )
    runs = read_recordings([path])
    assert len(runs) == 2
    for a, run in enumerate(runs):
        assert np.allclose(next(iter(run.joints.values())).position, Q + a, atol=1e-5)


def test_a_log_in_json_tells_no_rate_of_others(tmp_path: Path) -> None:
    """Only a file of settings does: a log's rate is its own."""
    rows = {"fs": 10, "data": {"q": list(Q), "q_cmd": list(U)}}
    (tmp_path / "old.json").write_text(json.dumps(rows))
    path = table(tmp_path / "new.csv", {"Zeit": T, "q": Q, "q_cmd": U})
    (run,) = read_recordings([path])
    assert np.allclose(next(iter(run.joints.values())).t, T, atol=1e-6)
    np.savez(tmp_path / "new.npz", q=Q, q_cmd=U)
    (run,) = read_recordings([tmp_path / "new.npz"], Request(rate=50.0))
    assert not any("old.json" in note for note in run.notes)


def test_sparse_columns_are_of_the_clock_that_was_said(tmp_path: Path) -> None:
    sparse = [f"{u:.9g}" if k % 5 == 0 else "" for k, u in enumerate(U)]
    path = table(tmp_path / "a.csv", {"time": 1e5 * T, "q": Q, "q_cmd": sparse})
    (run,) = read_recordings([path], Request(units={"time": "10us"}))
    log = next(iter(run.joints.values()))
    assert np.allclose(log.t, T, atol=1e-6)
    assert log.command is not None and np.allclose(log.command[:-5], U[:-5], atol=5e-3)


@pytest.mark.parametrize("numbered", [False, True])
def test_two_topics_of_one_file_are_of_the_same_joints(tmp_path: Path, numbered: bool) -> None:
    """What a plotting program exports of a state and of its controller, which has another order."""
    names = ("lift", "pan")
    places = {"pan": (Q, U), "lift": (0.5 * Q**2, 0.5 * U**2)}
    own = (lambda n: f"[{1 - names.index(n)}]") if numbered else (lambda n: f"/{n}_joint")
    columns: dict[str, Any] = {"__time": T + 1.7e9}
    for name, (q, u) in places.items():
        columns |= {
            f"/joint_states/{name}_joint/position": q,
            f"/joint_states/{name}_joint/effort": u,
        }
        columns |= {
            f"/fast_controller/state/desired/positions{own(name)}": u,
            f"/fast_controller/state/actual/positions{own(name)}": q + 1e-4 * np.cos(9 * T),
        }
    (run,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert sorted(run.joints) == ["lift", "pan"]
    for name, (q, u) in places.items():
        log = run.joints[name]
        assert log.command is not None and log.effort is not None
        assert np.allclose(log.position, q, atol=2e-4) and np.allclose(log.command, u, atol=1e-5)


@pytest.mark.parametrize("name", ["run_time", "Trial Time [s]", "episode_time"])
def test_a_time_within_a_run_is_no_number_of_it(tmp_path: Path, name: str) -> None:
    """Nor is a step, of which each row would be a run."""
    path = table(tmp_path / "a.csv", {name: T, "episode_step": np.arange(T.size), "q": Q, "u": U})
    (run,) = read_recordings([path])
    assert np.allclose(next(iter(run.joints.values())).t, T, atol=1e-6)
