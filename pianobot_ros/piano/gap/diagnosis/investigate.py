"""Find the cause by playing: diagnose, play the strikes that separate the leading explanations most
per second, and so on. Sequential design as of Box and Hill (1967); no clock, no ROS, no cell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.default_budgets import (
    DIAGNOSIS_BUDGET,
    INVESTIGATION_GOAL,
    INVESTIGATION_STRIKES,
    USUAL_STRIKES,
)
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.gap import Diagnosis, propose_experiment
from pianobot_ros.gap.explain.experiment import Proposal, together
from pianobot_ros.gap.posterior.table import surest
from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_recordings
from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes, phrase_of
from pianobot_ros.piano.gap.diagnosis.settings import options
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

__all__ = ["Decision", "Goal", "Investigation", "Step", "decide", "investigate"]

UNKNOWN = "unknown"
PAUSE = 1.0  # s between two strikes: vacuum, travel, and coming to rest
TELLS = 0.05
"""Nats that all that may still be played must be expected to tell, or nothing more is played: about
what moves a probability of 0.95 by a twentieth.
"""


@dataclass(frozen=True)
class Goal:
    """When it is enough: ``probability`` of one cause that has a name, or ``strikes`` played in
    all. The probability is of the causes that strikes can tell apart: that the library lacks the
    cause keeps what a foreign one that looks like it is worth, however much is played.

    A round plays ``conditions`` new strikes, each ``repeats`` times: fewer would not tell the floor
    of a condition that was never played. ``budget`` of simulated strikes for a diagnosis of as many
    as a first set has.
    """

    probability: float = INVESTIGATION_GOAL
    strikes: int = INVESTIGATION_STRIKES
    conditions: int = 3
    repeats: int = 3
    budget: int = DIAGNOSIS_BUDGET
    seed: int = 0

    def budget_for(self, strikes: int) -> int:
        """Budget of a diagnosis of so many strikes: each may predict its own as often."""
        return round(self.budget * max(1.0, strikes / USUAL_STRIKES))


@dataclass(frozen=True)
class Decision:
    """A diagnosis and what to do next: ``phrase`` to play, or ``ended`` ("goal", "nothing_tells" or
    "budget"). ``purpose`` says what for; ``expected`` nats of the phrase.
    """

    diagnosis: Diagnosis
    ended: str = ""
    phrase: dict[str, Any] = field(default_factory=dict)
    strikes: int = 0
    purpose: str = ""
    expected: float = 0.0


@dataclass(frozen=True)
class Step:
    """What was known after ``strikes``: the leading explanations with their probabilities, the gap
    (units of the floor) that they have to explain, and what the next ones were for.
    """

    strikes: int
    leading: tuple[tuple[str, float], ...]
    purpose: str
    gap: float


@dataclass(frozen=True)
class Investigation:
    """The last diagnosis, why it ended, and the steps on the way."""

    diagnosis: Diagnosis
    ended: str
    strikes: int
    steps: tuple[Step, ...]

    def to_json(self) -> dict[str, Any]:
        """What a result file holds beside the diagnosis."""
        steps = [
            {"strikes": s.strikes, "leading": dict(s.leading), "purpose": s.purpose, "gap": s.gap}
            for s in self.steps
        ]
        return {"ended": self.ended, "strikes": self.strikes, "steps": steps}


Choose = Callable[[PianoTwin, Diagnosis, Goal, int], Sequence[Proposal]]
"""Picks the strikes of a round: twin, diagnosis, goal and how many conditions fit; best first."""


def decide(recordings: Sequence[Recording], goal: Goal, choose: Choose | None = None) -> Decision:
    """Diagnose all ``recordings`` of a cell, and say what to play next."""
    played = sum(len(r.strikes) for r in recordings)
    budget = goal.budget_for(played)
    found = diagnose_recordings(list(recordings), seed=goal.seed, budget=budget)
    top = found.candidates[0]
    # that the cause is unknown names none: as long as a strike tells more, it is played
    most = surest(options().calibration)
    if top.name != UNKNOWN and top.probability >= goal.probability * most:
        return Decision(found, "goal", purpose=f"{top.name} holds {top.probability:.0%}")
    room = min((goal.strikes - played) // goal.repeats, goal.conditions)
    if room < 1:
        return Decision(found, "budget", purpose=f"{played} of {goal.strikes} strikes are played")
    twin = PianoTwin(recordings)
    best = (choose or most_per_second)(twin, found, goal, room)
    left = goal.strikes - played
    if together(best[:1], left) < TELLS:
        return Decision(found, "nothing_tells", purpose="no strike on offer tells more")
    typical = sorted(p.gain for p in best)[len(best) // 2]
    phrase = phrase_of([p.to_json(typical) for p in best], goal.repeats, "investigate")
    pairs = sorted({" and ".join(p.pair) for p in best})
    return Decision(
        found,
        phrase=phrase,
        strikes=goal.repeats * len(best),
        purpose="to tell apart " + "; ".join(pairs),
        expected=together(best, goal.repeats),
    )


def most_per_second(twin: PianoTwin, found: Diagnosis, goal: Goal, room: int) -> list[Proposal]:
    """The playable strikes that together tell most per second of playing, with their pauses: each
    is chosen for what it adds to those before.
    """
    offered = candidate_strikes(twin, goal.seed + len(twin.blocks))
    left = [p for p in propose_experiment(twin, found, offered) if playable(p)]
    chosen: list[Proposal] = []
    while left and len(chosen) < room:
        known = together(chosen, goal.repeats)
        best = max(left, key=lambda p: (together([*chosen, p], goal.repeats) - known) / _seconds(p))
        left.remove(best)
        chosen.append(best)
    return chosen


def _seconds(proposal: Proposal) -> float:
    a = proposal.block.attributes
    return 2.0 * a["depth"] / a["speed"] + a["hold"] + PAUSE


def playable(proposal: Proposal) -> bool:
    """Whether the strike passes the limits that any phrase has to pass."""
    text = yaml_text(phrase_of([proposal.to_json(1.0)], 1))
    try:
        return not plan_score(parse_phrase(text)).unreachable
    except ScoreError:
        return False


def investigate(
    first: Recording,
    play: Callable[[dict[str, Any]], Recording],
    goal: Goal,
    *,
    tell: Callable[[Step], None] | None = None,
    choose: Choose | None = None,
) -> Investigation:
    """The whole loop: ``play`` returns the recording of a phrase; ``tell`` hears each step."""
    recordings, steps = [first], []
    while True:
        decision = decide(recordings, goal, choose)
        played = sum(len(r.strikes) for r in recordings)
        leading = tuple((c.name, c.probability) for c in decision.diagnosis.candidates[:3])
        steps.append(Step(played, leading, decision.purpose, decision.diagnosis.gap.before))
        if tell:
            tell(steps[-1])
        if decision.ended:
            return Investigation(decision.diagnosis, decision.ended, played, tuple(steps))
        recordings.append(play(decision.phrase))
