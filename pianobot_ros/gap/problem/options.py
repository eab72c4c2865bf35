"""How the diagnosis is run, and the few calibrated constants that turn scores into
probabilities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pianobot_ros.gap.problem.budget import LIMIT
from pianobot_ros.gap.problem.errors import GapError


@dataclass(frozen=True)
class Scaling:
    """How the log odds of hypotheses become those of answers like them: times `power`, and moved by
    `unknown` towards *unknown*, by `quiet` towards "none" and "parameters", by `hidden` towards
    what may hide behind "parameters" (nats).
    """

    power: float = 1.0
    unknown: float = 0.0
    quiet: float = 0.0
    hidden: float = 0.0


@dataclass(frozen=True)
class Calibration:
    """Constants fitted on development cases only (never on test cases); see
    docs/diagnosis-method.md, *Calibration*.

    `temperature` and `event_temperature` divide held-out log scores of series and events before
    they become weights. `effect_log_odds` is the prior log odds of each structural effect
    against "parameters".
    """

    levels: Mapping[str, float] = field(default_factory=dict)
    """Mass that a credible set must hold, by group of first answers (`effect`, `unknown`, `quiet`:
    none or parameters), so that it holds the truth in 95 % of calibration cells; 0.95 where none
    is given."""
    scaling: Mapping[str, Scaling] = field(default_factory=dict)
    """How sure to be, by the same groups of first answers; as sure as the scores say where none is
    given."""
    temperature: float = 6.0
    event_temperature: float = 4.0
    law_precision: float = 0.01
    """Laws of the library are idealised: scores closer than this share of the leader's own gain, in
    each observable, are not told apart."""
    prior_temperature: float = 2.0
    """Divides the prior cost of stretched parameters, since priors are guesses too."""
    odd: float = 0.01
    """Share of sound cells whose parameters would be doubted although they close the gap (level of
    a test)."""
    effect_log_odds: float = -2.0
    pair_log_odds: float = -3.0
    parameter_log_odds: float = -0.5
    imprecision: float = 0.5
    """Share of a squared gap that the best effect leaves from which *unknown* is the likelier
    cause: what a law of the right kind leaves is less, what another kind leaves is more
    (benchmarks/priors.py: 0.49)."""
    law_error: float = 0.1
    """Standard deviation of what a law of the right kind is wrong by, as a share of what it does:
    it widens intervals (prior).
    """
    unknown_slope: float = 2.0
    """Power of the odds of what is left against what is explained, relative to `imprecision`
    (benchmarks/priors.py: 2.2)."""
    unknown_near: float = 0.5
    """Floors over which anything becomes possible, and *unknown*, from half of `material` on."""
    mimic: float = 0.06
    """Least probability of *unknown* where anything is claimed: a cause that the library lacks may
    look like one that it has, or like wrong values."""
    certain: float = 0.02
    """Least probability that *unknown* is not the cause."""
    hidden: float = 1.0
    """Factor on the odds of an effect that may hide behind refitted parameters: 1 where the normal
    priors of their sizes hold (benchmarks/priors.py: 1.3), more where more effects are weak."""
    below_floor: float = 2.0
    """Nats that count at most of what an effect fits better where refitting closes the gap: there a
    twin is wrong by trifles, which the law of another cause may follow (prior; without it two of
    six development joints of the servo axis with wrong parameters alone were *elasticity*)."""
    material: float = 0.30
    open_sigma: float = 1.0
    """Standard errors over blocks by which a squared gap must exceed the floor's square before it
    counts.
    """
    false_alarm: float = 0.02
    """Share of perfect twins of which chance alone may open any observable."""
    further: float = 0.5
    """Systematic gap, in floors, from which a further effect is looked for: a law is seldom exact,
    so some gap stays.
    """
    accept: float = 0.975
    """How sure an effect must be to predict better than what it is built on (level of a test)."""
    effect_share: float = 0.25
    """An effect must close this share of the squared gap above the floor that refitting leaves of
    an observable.
    """
    pair_share: float = 0.67
    """A further effect must close this share of what the law of the one before it may have left of
    an observable, being inexact; less is what another law follows of that.
    """

    @property
    def material_share(self) -> float:
        """Share of a squared gap that is material where nothing but it is above the floor."""
        return self.material**2 / (1.0 + self.material**2)


LEAST = {
    "folds": 2,
    "tolerance": 0.0,
    "timing_tolerance": 0.0,
    "shortlist": 1,
    "max_effects": 1,
    "min_units": 2,
    "max_samples": 1,
}
"""Of options that could not be obeyed below."""


@dataclass(frozen=True)
class Options:
    """Switches of `diagnose`; the defaults suit both a strike cell and an axis log."""

    folds: int = 5
    tolerance: float = 0.01
    """Believed error of the twin itself (step size, interpolation, unmodelled trifles), as a
    fraction of a signal's spread.
    """
    timing_tolerance: float = 0.25
    """Uncertainty of time stamps and interpolation, in sample intervals."""
    shortlist: int = 5
    """Effects refined nonlinearly after the linearised screening."""
    max_effects: int = 2
    """Largest number of effects named together."""
    min_units: int = 10
    """Scoring units: with fewer blocks than this, blocks are cut into equal pieces of time."""
    triage_iterations: int = 8
    """Steps that every shortlisted effect gets."""
    max_iterations: int = 40
    """Steps that the leading hypotheses get; most converge in ten."""
    max_samples: int = 100_000
    """Longer recordings are thinned by averaging neighbouring samples."""
    only: tuple[str, ...] = ()
    """Names of the effects to consider; empty means all."""
    backend: str = "loky"
    """joblib backend for `jobs` > 1: loky, threading, dask, ray."""
    calibration: Calibration = field(default_factory=Calibration)
    limit: float = LIMIT
    """Seconds of wall time after which no more is refined: an emergency brake."""

    def __post_init__(self) -> None:
        for name, least in LEAST.items():
            if not getattr(self, name) >= least:
                raise GapError(f"option {name} is {getattr(self, name)}: give at least {least}")

    def taught(self, learned: Mapping[str, Any]) -> Options:
        """These options with what `benchmarks/calibrate.py` learned, as a document of plain types:
        `temperatures` by kind of observable, `scaling` and `levels` by group of first answers.
        """
        known = self.calibration
        temperatures = learned.get("temperatures", {})
        calibration = replace(
            known,
            temperature=temperatures.get("series", known.temperature),
            event_temperature=temperatures.get("event", known.event_temperature),
            scaling={g: Scaling(**scale) for g, scale in learned.get("scaling", {}).items()},
            levels=dict(learned.get("levels", {})),
        )
        return replace(self, calibration=calibration)
