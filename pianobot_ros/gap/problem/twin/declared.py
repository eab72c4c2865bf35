"""What a twin declares, checked before it is called: a contradiction is said, not guessed at."""

from __future__ import annotations

from collections.abc import Sequence

from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Effect, Observable, Parameter, Stage, Twin

__all__ = ["check_declared"]


def check_declared(twin: Twin) -> None:
    """Raise GapError for a twin that contradicts itself."""
    _refuse_others(twin)
    stages = {s.name for s in twin.stages}
    staged = [p for p in twin.parameters if p.stage]
    staged += [p for e in twin.effects for p in e.parameters]
    things: list[Observable | Effect | Parameter] = [*twin.observables, *twin.effects, *staged]
    for thing in things:
        if thing.stage not in stages:
            raise GapError(
                f"{thing.name}: stage {thing.stage!r} is none of the twin's stages {sorted(stages)}"
            )
    for what, names in (
        ("observables", [o.name for o in twin.observables]),
        ("effects", [e.name for e in twin.effects]),
    ):
        if len(set(names)) < len(names):
            raise GapError(f"the twin's {what} need different names, got {names}")
    taken = {"none", "parameters", "unknown"}.intersection(e.name for e in twin.effects)
    if taken:
        raise GapError(f"no effect may be called {' or '.join(sorted(taken))}: these are answers")
    own = [p.name for p in twin.parameters]
    there = [o.name for o in twin.observables]
    for o in twin.observables:
        for what, name, known in (
            ("observable", o.spliced, there),
            ("parameter", o.gain, own),
        ):
            if name and name not in known:
                raise GapError(
                    f"{o.name} is spliced behind {o.spliced!r} with gain {o.gain!r}: the twin has"
                    f" no {what} {name!r}"
                )
    own += [p.name for e in twin.effects for p in e.parameters]
    if len(set(own)) < len(own):
        double = sorted({n for n in own if own.count(n) > 1})
        raise GapError(
            f"parameter names must be unique over nuisances and effects, twice: {double}"
        )


def _refuse_others(twin: Twin) -> None:
    """Raise GapError where what a twin declares is of another type."""
    if isinstance(twin, type):
        raise GapError(f"the twin is the class {twin.__name__}: give one of its instances")
    for kind in (Stage, Observable, Parameter, Effect):
        what = kind.__name__.lower()
        given = getattr(twin, f"{what}s")
        if not isinstance(given, Sequence):  # what can be read only once would be empty then
            raise GapError(f"the twin's {what}s are a {type(given).__name__}: give a list")
        for one in given:
            if not isinstance(one, kind):
                article = "an" if what[0] in "eo" else "a"
                raise GapError(
                    f"{what} {one!r} is a {type(one).__name__}: give {article} {kind.__name__}"
                )
