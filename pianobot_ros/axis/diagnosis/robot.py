"""All joints of a robot, from its recordings to one finding for each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from joblib import Parallel, delayed

from pianobot_ros.axis.diagnosis.joint import Finding, diagnose_joint
from pianobot_ros.axis.diagnosis.robot_model import RobotModel
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading import RobotRun
from pianobot_ros.axis.reading.headers.phrases import same_joint
from pianobot_ros.gap import GapError

__all__ = ["RobotFinding", "diagnose_robot", "logs_by_joint", "with_model"]


@dataclass(frozen=True)
class RobotFinding:
    """A finding for each joint that could be diagnosed; of the others, why not."""

    joints: Mapping[str, Finding]
    left_out: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """The finding of the only joint, or those of all by name; plain JSON types."""
        if len(self.joints) == 1 and not self.left_out:
            return next(iter(self.joints.values())).to_json()
        return {
            "joints": {name: f.to_json() for name, f in self.joints.items()},
            "left_out": dict(self.left_out),
        }


def logs_by_joint(
    recordings: Iterable[RobotRun], wanted: Sequence[str] = ()
) -> dict[str, list[Log]]:
    """Logs of each joint over all recordings; `wanted` are some of them, also as the robot calls
    them. Raises GapError on a joint that is nowhere.
    """
    out: dict[str, list[Log]] = {}
    for recording in recordings:
        for joint, log in recording.joints.items():
            out.setdefault(joint, []).append(log)
    if not wanted:
        return out
    chosen: dict[str, list[Log]] = {}
    for name in wanted:
        own = [name] if name in out else [j for j in out if same_joint(name, j)]
        if len(own) != 1:
            there = ", ".join(j or "(unnamed)" for j in out)
            raise GapError(f"no joint {name!r}; there are {there}")
        chosen[own[0]] = out[own[0]]
    return chosen


def with_model(logs: Mapping[str, Sequence[Log]], model: RobotModel) -> dict[str, list[Log]]:
    """The logs with what a model of the robot says of each joint; a joint that the model lacks
    stays as it is, and that is said.
    """
    return {joint: [model.told(log) for log in own] for joint, own in logs.items()}


def diagnose_robot(
    logs: Mapping[str, Sequence[Log]],
    *,
    reference: Mapping[str, Sequence[Log]] | None = None,
    jobs: int = 1,
    tell: Callable[[str], None] | None = None,
    **how: Any,
) -> RobotFinding:
    """Diagnose every joint, `jobs` at a time; `tell` hears of each of several that is begun or
    done; `how` goes to `diagnose_joint`.

    Raises GapError with the first joint's reason if none can be diagnosed.
    """
    reference = reference or {}
    _driven([log for own in logs.values() for log in own])
    lonely = {j for j in logs if reference and j not in reference}
    side = min(jobs, len(logs))
    tasks = (
        delayed(_one)(own, reference.get(joint, ()), jobs=1 if side > 1 else jobs, **how)
        for joint, own in _begun(logs, tell)
    )
    done: list[Finding | str] = []
    made = Parallel(n_jobs=side, return_as="generator", pre_dispatch="n_jobs")(tasks)
    for joint, found in zip(logs, made, strict=True):
        done.append(found)
        if tell is not None and len(logs) > 1:
            what = found.diagnosis.verdict if isinstance(found, Finding) else "left out"
            tell(f"{len(done)} of {len(logs)} joints: {joint or '(unnamed)'} ({what})")
    joints = {j: f for j, f in zip(logs, done, strict=True) if isinstance(f, Finding)}
    left_out = {j: f for j, f in zip(logs, done, strict=True) if isinstance(f, str)}
    for joint in sorted(lonely & set(joints)):
        joints[joint].notes.append("the reference holds no such joint")
    if not joints:
        raise GapError(next(iter(left_out.values()), "no joint was found"))
    return RobotFinding(joints, left_out)


def _begun(
    logs: Mapping[str, Sequence[Log]], tell: Callable[[str], None] | None
) -> Iterator[tuple[str, Sequence[Log]]]:
    """The joints; of several each is told of when it is taken up: a verdict takes a minute."""
    for k, (joint, own) in enumerate(logs.items()):
        if tell is not None and len(logs) > 1:
            tell(f"diagnosing {joint or '(unnamed)'} ({k + 1} of {len(logs)})")
        yield joint, own


def _driven(logs: Sequence[Log]) -> None:
    """Raises GapError if no joint has a command or an effort."""
    if logs and all(log.command is None and log.effort is None for log in logs):
        run = logs[0].name.removesuffix(logs[0].joint).strip()
        raise GapError(
            f"{run}: no joint has a command or an effort"
            " column, of which a diagnosis needs one; --columns command=HEADER or effort=HEADER"
            " names it, and `axis columns` lists what there is"
        )


def _one(logs: Sequence[Log], reference: Sequence[Log], **how: Any) -> Finding | str:
    try:
        return diagnose_joint(logs, reference=reference, **how)
    except GapError as error:
        return str(error)
    except (ArithmeticError, LookupError, MemoryError, ValueError) as error:
        # what strange numbers make a solver throw; the other joints are still diagnosed
        what = " ".join(str(error).split())[:100] or type(error).__name__
        return f"{logs[0].name}: its numbers cannot be fitted ({type(error).__name__}: {what})"
