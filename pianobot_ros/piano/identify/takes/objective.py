"""The paper's objective, Eqs. 3 to 5, with its slips made explicit.

As printed, λ1 + λ2 = 0 (it must be 1), f_d adds metres per second and f_a seconds, and |ΔT_idle|
equals |ΔT_hold| because T_idle = T_N - T_hold, so that articulation is counted twice. Here every
difference is divided by the reference's own value (as Eq. 5 does), and ``hold_once`` is offered
beside the paper's sum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.recordings.keystroke import PAPER_LAMBDA, Keystroke, keystroke_error
from pianobot_ros.piano.identify.takes.take import Take
from pianobot_ros.piano.twin.reduced.strike_model import Stroke

__all__ = ["Form", "Objective", "comparable"]

Form = Literal["paper", "hold_once"]
# penalty for a key that should sound and does not; every term of a key that sounds stays well below
# it
MISSED = 3.0


@dataclass(frozen=True)
class Objective:
    """λ1 f_d + λ2 f_a, the mean over takes. Raises :class:`ConfigError` unless the weights are 0 to
    1 and sum to 1.
    """

    weights: tuple[float, float] = PAPER_LAMBDA
    form: Form = "paper"

    def __post_init__(self) -> None:
        if self.form not in get_args(Form):
            raise ConfigError(unknown_name("objective", str(self.form), get_args(Form)))
        if not (all(0 <= w <= 1 for w in self.weights) and abs(sum(self.weights) - 1) < 1e-6):
            raise ConfigError(
                f"lambda1 and lambda2 must lie in 0 to 1 and sum to 1, got {self.weights[0]} and"
                f" {self.weights[1]}"
            )

    def __call__(
        self, takes: Sequence[Take], strokes: Sequence[Stroke], found: Sequence[Keystroke | None]
    ) -> float:
        """The objective for what the twin played: ``strokes`` and the keystrokes ``found`` in
        them.
        """
        return float(
            np.mean([self._one(t, s, k) for t, s, k in zip(takes, strokes, found, strict=True)])
        )

    def _one(self, take: Take, stroke: Stroke, found: Keystroke | None) -> float:
        if (take.reference is None) != (found is None):
            # How far the key is from where it should be gives the search a slope where there is no
            # note.
            short = abs(float(stroke.angle.max()) - take.midi.trigger_on) / take.midi.trigger_on
            return MISSED + min(short, 1.0)
        if take.reference is None or found is None:
            return 0.0
        # Eq. 4 in relative terms is twice Eq. 5.
        sim, reference = comparable(found, take.reference)
        return min(
            2.0 * keystroke_error(sim, reference, self.weights, self.form == "paper"), MISSED
        )

    def err(self, takes: Sequence[Take], found: Sequence[Keystroke | None]) -> float:
        """Err of Eq. 5 (fraction), the mean over the takes in which both sounded; NaN if there is
        none.
        """
        errors = [
            keystroke_error(*comparable(k, t.reference), self.weights)
            for t, k in zip(takes, found, strict=True)
            if k is not None and t.reference is not None
        ]
        return float(np.mean(errors)) if errors else float("nan")


def comparable(found: Keystroke, reference: Keystroke) -> tuple[Keystroke, Keystroke]:
    """Both keystrokes; where the reference does not say V_rel (most MIDI files do not), V_pre
    stands for it in both, so that the dynamics are judged by V_pre alone.
    """
    if np.isfinite(reference.v_rel):
        return found, reference
    return replace(found, v_rel=found.v_pre), replace(reference, v_rel=reference.v_pre)
