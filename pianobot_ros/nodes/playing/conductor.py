"""``conductor``: plays phrases on both cells.

Action ``/play_phrase`` (PlayPhrase): plans the score, then streams ``/command/wrist`` at the
arm's rate on an absolute time base, ``/command/vacuum`` when it changes and once a second, and one
``/command/strike``
shortly before each strike. Between phrases nothing is streamed: the arm holds. Cancel brings the
wrist up smoothly.

Strikes that were lost (:mod:`pianobot_ros.nodes.session.lost_strikes`) are played once more at the
end of the phrase, at most twice; what is lost then is said in the result.

Each setpoint is sent ``lead`` seconds before the time that it is stamped with, and both cells obey
it at that time: a delay of this process, or on the way, does not shape the motion.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pianobot_msgs.action import PlayPhrase

from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cell.host.priority import ordinary
from pianobot_ros.cell.score import (
    Plan,
    Score,
    load_score,
    parse_phrase,
    plan_score,
)
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.base.jobs import OneJob
from pianobot_ros.nodes.playing.cells import Cells
from pianobot_ros.nodes.playing.streaming import Streamer
from pianobot_ros.nodes.playing.supervised import SupervisorWatch
from pianobot_ros.nodes.session.lost_strikes import ARRIVAL, REPEATS, Passage, why_lost
from pianobot_ros.nodes.session.notes import Listener
from pianobot_ros.nodes.session.refused_commands import OneSidedRefusals

__all__ = ["Conductor", "main"]

BACK = 30.0  # s within which a killed node is back, on a busy machine too


class Conductor(common.PianoNode):
    """The node. Goals are executed on a thread of their own, so that the executor stays free for
    cancel and states.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("conductor", **options)
        self._rate = self.declare("rate", 125.0, "Hz of the wrist setpoints", 50.0, 500.0)
        lead = self.declare(
            "lead", 0.05, "s by which a setpoint is sent before it is to be obeyed", 0.0, 0.15
        )
        require = self.declare(
            "require",
            ["real", "sim"],
            "cells that must report their wrist before a phrase is played",
            choices=["real", "sim"],
        )
        self.declare(
            "ready_timeout",
            5.0,
            "s to wait for the cells at the start of a phrase",
            0.0,
            120.0,
            changes="any",
        )
        self.declare("transpose", 0, "semitones added to every score", -60, 60, changes="any")
        self._guard = OneJob(self, "a phrase is being played; cancel it first")
        self._cells = Cells(self, require, self._guard.stopping)
        self._notes = Listener(self, ("real", "sim"))
        self._refusals = OneSidedRefusals(self, ("real", "sim"))
        listeners = (self._notes.look, self._refusals.take)
        self._streamer = Streamer(self, self._rate, lead, self._cells, listeners)
        self._wrist = self._streamer.wrist
        self._playing = ""
        self._supervisor = SupervisorWatch(self)
        play = self._guard.executes(self._play, low_priority=False)
        self._server = self._guard.serve(PlayPhrase, "/play_phrase", play)

    def diagnose(self) -> Mapping[str, Health]:
        """What is playing, and how many setpoints came after their time."""
        stream = self._streamer
        level = HealthLevel.WARN if stream.late else HealthLevel.OK
        text = f"playing {self._playing}" if self._playing else "idle"
        values = {
            "setpoints": stream.sent,
            "late": stream.late,
            "worst_lateness_ms": 1e3 * stream.worst_late,
        }
        return {"conductor": Health(level, text, 0.0, values)}

    def shut_down(self) -> None:
        """Bring the wrist up before leaving."""
        self._supervisor.close()
        self._guard.close(4.0)
        self._server.destroy()

    # Goals.

    def _play(self, goal: Any) -> tuple[str, PlayPhrase.Result]:
        result = PlayPhrase.Result()
        try:
            with ordinary():
                score = self._score(goal.request)
            self._playing = score.name
            lost = self._perform(score, goal, result)
            result.unreachable = [*score.unreachable, *lost]
            if self._ended(goal):
                result.message = (
                    f"cancelled after {result.strikes} of {len(score.places)} strikes; the wrist is"
                    " up"
                )
                return ("canceled" if goal.is_cancel_requested else "aborted"), result
            result.success = True
            result.message = _summary(score, result.strikes, lost)
            heard = self._notes.present()
            if silent := [c for c in self._cells.require if c not in heard]:
                result.message += f"; nobody publishes notes of the cell: {', '.join(silent)}"
        except PianobotError as error:
            result.message = str(error)
            self.get_logger().error(f"cannot play: {error}")
            return "aborted", result
        except Exception as error:
            self.get_logger().error(f"playing failed: {type(error).__name__}: {error}")
            result.message = f"internal error: {error}"
            return "aborted", result
        else:
            self.get_logger().info(result.message)
            return "succeeded", result
        finally:
            self._playing = ""

    def _ended(self, goal: Any) -> bool:
        return self._guard.stopping.is_set() or bool(goal.is_cancel_requested)

    def _score(self, request: PlayPhrase.Goal) -> Score:
        """What is asked for, once the cells are ready for it. Raises :class:`PianobotError`."""
        tempo, transpose = request.tempo or 1.0, int(self.get_parameter("transpose").value)
        if request.phrase_yaml and request.score:
            raise ScoreError("give score or phrase_yaml, not both")
        if request.phrase_yaml:
            score = parse_phrase(request.phrase_yaml, transpose=transpose, tempo=tempo)
        elif request.score:
            score = load_score(request.score, transpose=transpose, tempo=tempo)
        else:
            raise ScoreError("there is no score: give a file, the name of a phrase, or phrase_yaml")
        self._wait_ready()
        for line in score.unreachable:
            self.get_logger().warning(f"left out: {line}")
        return score.repeated(int(request.repeats))

    def _perform(self, score: Score, goal: Any, result: PlayPhrase.Result) -> list[str]:
        """Play the score, then what was lost of it; counts the strikes in ``result`` and returns a
        line for each that is lost at the end.

        Raises :class:`PianobotError` if the arm does not play on.
        """
        todo, places, first = score, list(range(len(score.strikes))), 0
        audible = self._notes.present()
        for take_number in range(1 + REPEATS):
            with ordinary():
                plan = plan_score(
                    todo,
                    self._cells.start_pose(),
                    period=1.0 / self._rate,
                    number=first,
                    in_time=take_number == 0,
                )
            self.get_logger().info(
                f"playing {plan.name}: {len(plan.strikes)} strikes, {plan.duration:.1f} s"
            )
            take = self._streamer.play(plan, goal, first, lambda: self._ended(goal))
            result.strikes += take.begun
            if self._ended(goal):
                return []
            lost = self._lost(plan, take, audible)
            given_up = ""
            if take.reasons:
                refused = self._refusals.between(take.epoch, time.time())
                given_up = _given_up(plan, take, refused)
            if given_up and (take_number == REPEATS or len(lost) == len(plan.strikes)):
                raise PianobotError(given_up)
            if not lost or take_number == REPEATS:
                break
            if given_up:
                self._wait_back(given_up)
            first += take.announced
            again = sorted({todo.places[i] for i in lost})
            todo, places = todo.again(again), [places[i] for i in again]
            for line in lost.values():
                self.get_logger().warning(f"lost, to be played once more: {line}")
        return [
            f"strike {places[todo.places[i]] + 1} of {len(score.strikes)}, {line}"
            for i, line in lost.items()
        ]

    def _lost(self, plan: Plan, take: Passage, audible: Sequence[str]) -> dict[int, str]:
        """Why strikes of the take do not count, by their place among its marks; ``audible`` are the
        cells whose notes somebody published when the phrase began. Notes have time to arrive:
        returns at once only if none is missing.
        """
        last = max(take.epoch + m.end for m in plan.strikes[: take.begun]) if take.begun else 0.0
        while True:
            self._notes.look()
            self._refusals.take()
            cells, lost = {*audible, *self._notes.present()}, {}
            for i, mark in enumerate(plan.strikes):
                window = (take.epoch + mark.start, take.epoch + mark.end)
                sounded = {c: self._notes.sounded(c, mark.note, *window) for c in cells}
                if why := why_lost(take, i, mark, sounded, self._refusals.between(*window)):
                    lost[i] = f"note {mark.note} ({mark.condition}): {why}"
            if not lost or time.time() > last + ARRIVAL or self._guard.stopping.is_set():
                return lost
            time.sleep(0.02)

    def _wait_ready(self) -> None:
        """Wait until every required cell reports a wrist that can move. Raises
        :class:`PianobotError` saying which does not.
        """
        self._cells.forget()
        if reasons := self._cells.missing(float(self.get_parameter("ready_timeout").value)):
            raise PianobotError("; ".join(reasons))

    def _wait_back(self, given_up: str) -> None:
        """Wait until a phrase that was ``given_up`` can go on. Raises :class:`PianobotError` if it
        cannot: a safety stop is for people to clear, and what it ended is not played on.
        """
        if self._cells.stopped or self._cells.missing(BACK):
            raise PianobotError(given_up)
        self.get_logger().warning(f"{given_up}; it goes on")


def _given_up(plan: Plan, take: Passage, refused: str) -> str:
    """Why a phrase ended early, with what was ``refused`` meanwhile."""
    reasons = "; ".join([*take.reasons, *([refused] if refused else [])])
    if take.begun < len(plan.strikes):
        return f"given up after {take.begun} of {len(plan.strikes)} strikes: {reasons}"
    return f"played to the end, but {reasons}"


def _summary(score: Score, played: int, lost: Sequence[str]) -> str:
    """One line about a phrase that was played to its end."""
    asked = len(score.places)
    text = f"{score.name}: {played} strike{'s' if played != 1 else ''} played"
    if played > asked:
        text += f", {played - asked} of them once more"
    if lost:
        text += f"; {len(lost)} of {asked} lost: {'; '.join(lost[:3])}"
        text += " …" if len(lost) > 3 else ""
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(Conductor, arguments, realtime=common.REALTIME_PRIORITY)


if __name__ == "__main__":
    sys.exit(main())
