"""What a twin, a recording and an effect look like to the diagnosis. Nothing here knows a piano, a
robot or ROS.

A *block* is one strike, one repeat or one segment of a log. Blocks that share a `condition` (and a
`history`) are repeats of each other and give the repeatability floor. A *twin* predicts every
*observable* of a block; an observable is one measured signal (or event) predicted by one *stage*
from the measured signals upstream of it ("spliced in"), so that its residual is that stage's own
gap. The same measured signal may appear under several splicings and modes.

All numbers are SI unless the twin says otherwise in `unit`; the engine only ever compares a signal
with itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol, TypeAlias, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.problem.constants import ROUNDING
from pianobot_ros.gap.problem.errors import GapError

Array: TypeAlias = NDArray[np.float64]
Prediction: TypeAlias = Mapping[str, "Array | float"]
"""One block's prediction: observable name to series (n,) at the measured time stamps, or to an
event's value.
"""


@dataclass(frozen=True)
class Signal:
    """A sampled signal: `t` (n,) seconds, not necessarily uniform or starting at 0; `y` (n,) in
    `unit`; NaN = missing.
    """

    t: Array
    y: Array
    unit: str = ""

    def __post_init__(self) -> None:
        t, y = np.asarray(self.t, float), np.asarray(self.y, float)
        if t.ndim != 1 or t.shape != y.shape:
            raise GapError(
                f"a signal needs t and y of one equal length, got shapes {t.shape} and {y.shape}"
            )
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "y", y)


def usable(signal: Signal) -> NDArray[np.intp]:
    """Indices (n,) of the samples that are numbers, in the order of their stamps."""
    kept = np.flatnonzero(np.isfinite(signal.t) & np.isfinite(signal.y))
    t = signal.t[kept]
    return kept if np.all(np.diff(t) >= 0) else kept[np.argsort(t, kind="stable")]


@dataclass(frozen=True)
class Block:
    """One strike, one repeat or one segment of a log.

    `inputs` are what was commanded or is spliced in, `outputs` what was measured (an output may be
    spliced in downstream). `events` are scalars (times in s, counts, velocities), NaN where the
    event did not happen. `phases` are (t0, t1) on the signals' clock. `attributes` describe the
    block (speed, load, temperature, ...): what repeats differ by along one is no scatter, and an
    unknown's residual may depend on it. None is an answer of the machine (a peak force).
    `history` says what came before, where it may matter: what repeats of a condition with different
    histories differ by is no scatter. `units` of those attributes that say how the block is driven:
    these are told where it is proposed to be played.
    """

    name: str
    condition: str
    inputs: Mapping[str, Signal]
    outputs: Mapping[str, Signal]
    events: Mapping[str, float] = field(default_factory=dict)
    phases: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    attributes: Mapping[str, float] = field(default_factory=dict)
    history: str = ""
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what, signals in (("input", self.inputs), ("output", self.outputs)):
            for name, s in signals.items():
                if not isinstance(s, Signal):
                    raise GapError(
                        f"block {self.name}: {what} {name} is a {type(s).__name__}; give a Signal"
                    )
        hints = (
            ("event", self.events, "NaN where it did not happen; left out if not recorded"),
            ("attribute", self.attributes, "a number for each kind, or a condition of its own"),
        )
        for what, numbers, hint in hints:
            for name, x in numbers.items():
                try:
                    float(x)
                except (TypeError, ValueError):
                    raise GapError(
                        f"block {self.name}: {what} {name} is {x!r}; give a number ({hint})"
                    ) from None
        for name, phase in self.phases.items():
            if np.shape(phase) != (2,) or phase[0] > phase[1]:
                raise GapError(
                    f"block {self.name}: phase {name} is {phase!r}; give when it begins and ends"
                    " (s, on the signals' clock)"
                )


@dataclass(frozen=True)
class Parameter:
    """A number of the twin with its prior: Normal(nominal, sd), in log space if `log`; hard bounds
    `low`, `high`.

    `sd` is in the transformed scale: 0.1 with `log` means 10 %. For the magnitude of an effect,
    `nominal` is the centre of the prior (usually the null value) and `sd` its expected size.
    """

    name: str
    nominal: float
    low: float
    high: float
    unit: str = ""
    stage: str = ""
    sd: float = 0.1
    log: bool = False

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise GapError(f"parameter {self.name}: low {self.low:g} is above high {self.high:g}")
        if not self.low <= self.nominal <= self.high:
            raise GapError(
                f"parameter {self.name}: nominal {self.nominal:g} is outside [{self.low:g},"
                f" {self.high:g}]"
            )
        if self.log and self.low <= 0:
            raise GapError(
                f"parameter {self.name}: a log-scaled parameter needs a lower bound above 0"
            )
        if not self.sd > 0:
            raise GapError(f"parameter {self.name}: the prior's sd must be above 0")

    def same(self, a: float, b: float) -> bool:
        """Whether two of its values are one, to the share of the range that tells a bound."""
        return abs(a - b) <= ROUNDING * (self.high - self.low)


@dataclass(frozen=True)
class Stage:
    """One link of the causal chain, in causal order in `Twin.stages`."""

    name: str
    description: str = ""


Kind = Literal["series", "event"]
Mode = Literal["forward", "inverse", "horizon"]


@dataclass(frozen=True)
class Observable:
    """A measured quantity as predicted by one stage with its upstream spliced in.

    `signal` names an entry of `Block.outputs` (kind "series") or `Block.events` (kind "event").
    `mode` says how it is
    predicted: "forward" (cause to effect), "inverse" (motion back to force or current) or "horizon"
    (re-initialised from the measured state every so often). `floor_hint` is the smallest believable
    repeatability (resolution, data sheet), in `unit`; `tolerance` is how wrong the twin may be
    before it counts, in `unit` (NaN: a fraction of the signal's spread, see `Options.tolerance`).
    `spliced` is the observable of the signal that is spliced in, and `gain` the twin's parameter
    that is a factor of it: what nobody would claim of that signal is not claimed behind it either
    (`floor/splice.py`). Either empty: what is spliced in is as good as exact.
    """

    name: str
    stage: str
    signal: str
    unit: str = ""
    kind: Kind = "series"
    mode: Mode = "forward"
    floor_hint: float = 0.0
    tolerance: float = float("nan")
    spliced: str = ""
    gain: str = ""

    def __post_init__(self) -> None:
        for said, valid in ((self.kind, get_args(Kind)), (self.mode, get_args(Mode))):
            if said not in valid:
                raise GapError(
                    f"observable {self.name}: {said!r} is none of {', '.join(map(repr, valid))}"
                )
        for what, size in (("floor_hint", self.floor_hint), ("tolerance", self.tolerance)):
            if size < 0:
                raise GapError(f"observable {self.name}: {what} is {size:g}; give 0 or more")


@dataclass(frozen=True)
class Effect:
    """A structural term of the library: it vanishes when parameter `magnitude` equals `null`, or
    leaves another one of the library, its `remainder`: that one's name, and which of the own
    parameters each of its is. An effect is named only where it does more than its remainder.

    `starts` are the parameter values tried when the effect is first probed (several sizes, both
    signs where it has one): many effects have no derivative at null (backlash, friction), so one
    probe is not enough. Parameters that name no stage are of the effect's.

    `law` is what acts in the twin at `stage`: a function, or an object with the functions that the
    stage needs. The twin calls it; the engine does not.
    """

    name: str
    stage: str
    parameters: Sequence[Parameter]
    starts: Sequence[Mapping[str, float]]
    magnitude: str = ""
    null: float = 0.0
    description: str = ""
    law: Any = None
    remainder: tuple[str, Mapping[str, str]] | None = None

    def __post_init__(self) -> None:
        for what, given, kind in (
            ("parameters", self.parameters, Parameter),
            ("starts", self.starts, Mapping),
        ):
            if not isinstance(given, Sequence) or not all(isinstance(x, kind) for x in given):
                raise GapError(f"effect {self.name}: {what} must be a list, each a {kind.__name__}")
        own = tuple(p if p.stage else replace(p, stage=self.stage) for p in self.parameters)
        object.__setattr__(self, "parameters", own)
        object.__setattr__(self, "starts", tuple(self.starts))
        names = [p.name for p in self.parameters]
        if not names or not self.starts:
            raise GapError(f"effect {self.name}: needs at least one parameter and one start")
        if not self.magnitude:
            object.__setattr__(self, "magnitude", names[0])
        if self.magnitude not in names:
            raise GapError(
                f"effect {self.name}: magnitude {self.magnitude!r} is none of its parameters"
                f" {names}"
            )
        if self.remainder is not None and set(self.remainder[1].values()) - set(names):
            raise GapError(f"effect {self.name}: its remainder has parameters that are none of its")
        for start in self.starts:
            if set(start) - set(names):
                raise GapError(
                    f"effect {self.name}: start names unknown parameters"
                    f" {sorted(set(start) - set(names))}"
                )
        self._refuse_unseen()

    def _refuse_unseen(self) -> None:
        """Raise GapError where its range holds no null, or a start does nothing: no screening would
        see it.
        """
        size = self.size
        if not size.low <= self.null <= size.high:
            raise GapError(
                f"effect {self.name}: its null {self.null:g} is outside [{size.low:g},"
                f" {size.high:g}], the range of {size.name}"
            )
        for start in self.starts:
            at = self.at(start)
            if at[size.name] == self.null:
                raise GapError(
                    f"effect {self.name}: the start {dict(start)} leaves {size.name} at its null,"
                    " where nothing is seen of it; give a size that matters"
                )

    @property
    def size(self) -> Parameter:
        """The parameter that is its magnitude."""
        return next(p for p in self.parameters if p.name == self.magnitude)

    def at(self, start: Mapping[str, float]) -> dict[str, float]:
        """All its parameters at a start: nominal where that says nothing."""
        return {p.name: p.nominal for p in self.parameters} | dict(start)

    def shrunk(self, start: Mapping[str, float], share: float) -> dict[str, float]:
        """All its parameters at a start, with a `share` of its size there."""
        own = self.at(start)
        own[self.magnitude] = self.null + share * (own[self.magnitude] - self.null)
        return own

    @classmethod
    def of_size(
        cls,
        size: Parameter,
        starts: Sequence[float],
        description: str,
        further: Sequence[Parameter] = (),
        law: Any = None,
    ) -> Effect:
        """The effect that has name and stage of its ``size``, and whose `starts` are values of it;
        ``further`` parameters begin at their nominal values.
        """
        tried = [{size.name: x} for x in starts]
        return cls(size.name, size.stage, [size, *further], tried, description=description, law=law)


@runtime_checkable
class Twin(Protocol):
    """What `diagnose` needs from a simulator. Optional extras, used when present:

    - `simulate_many(blocks, requests)` with `requests` a list of `(values, effects)`: one batched
      or parallel call;
    - `recentre(values)` for a twin that approximates: a twin that is most exact near these nuisance
      values. It is called with the nominal ones, then with the refitted ones, so that no effect
      wins by escaping an approximation;
    - `features(block)` to name what an unexplained residual may depend on beside the inputs:
      feature name to Signal;
    - `guesses`: combinations of effects that are fitted before any search, best first, each
      {effect: {parameter: value}}.
    """

    @property
    def stages(self) -> Sequence[Stage]:
        """Stages in causal order."""
        ...

    @property
    def observables(self) -> Sequence[Observable]:
        """What is compared."""
        ...

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Nuisance parameters: refitted with every candidate."""
        ...

    @property
    def effects(self) -> Sequence[Effect]:
        """The library."""
        ...

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> Sequence[Prediction]:
        """Predict every block: `values` holds every nuisance parameter and the parameters of the
        active `effects`.

        A series comes back at the measured time stamps of its signal; NaN where the twin makes no
        prediction. An observable whose signal a block lacks may be left out.
        """
        ...
