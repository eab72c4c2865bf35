"""What the user says about logs, and the columns of a log's tables that it names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pianobot_ros.axis.log import ROLES
from pianobot_ros.axis.reading.columns.unit_scales import said_unit
from pianobot_ros.axis.reading.formats.table import some_of
from pianobot_ros.axis.reading.headers.phrases import same_joint
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.vocabulary import FILLERS
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.axis.reading.source import Source
from pianobot_ros.gap.problem.errors import GapError

__all__ = ["NAMED", "Request", "as_named"]

NAMED = -1
"""Rank of a column that the user named."""
NONE = ("-",)
BEHIND = 20
"""Ranks that other columns fall behind where those of a single joint were named."""


@dataclass(frozen=True)
class Request:
    """What the user says about the logs: columns and units by role, and the rate without stamps.

    A role's columns are a header, a number, a list of both (`1,2` or a sequence), a range (`1-6`)
    or what the headers of a group have in common; `-` for none. A unit is that of a role, or of one
    joint's (`elbow:velocity`).
    """

    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    rate: float = 0.0

    def __post_init__(self) -> None:
        for role in (*self.columns, *(key.rpartition(":")[2] for key in self.units)):
            if role not in {*ROLES, "error"}:
                raise GapError(
                    f"unknown column role {role!r}; valid: {', '.join([*ROLES, 'error'])}"
                )
        known = {k: said_unit(k.rpartition(":")[2], u) for k, u in self.units.items()}
        object.__setattr__(self, "units", known)
        for role in self.columns:
            if "-" in self.said(role) and len(self.said(role)) > 1:
                raise GapError(f"--columns {role}=- says that there is none, and another names one")

    def said(self, role: str) -> tuple[str, ...]:
        """What was said of a role's columns, once each; () if nothing."""
        given = self.columns.get(role, ())
        return tuple(dict.fromkeys([given] if isinstance(given, str) else given))

    def names(self, role: str) -> bool:
        """Whether columns of a role were named."""
        return self.said(role) not in {(), NONE}

    def units_of(self, joint: str) -> dict[str, str]:
        """Units by role for a joint: those of all, but for its own (`JOINT:ROLE`)."""
        shared = {k: u for k, u in self.units.items() if ":" not in k}
        parts = [(*k.rpartition(":"), u) for k, u in self.units.items() if ":" in k]
        own = {role: u for name, _, role, u in parts if same_joint(name, joint)}
        return shared | own

    def only_of(self, joints: Sequence[str]) -> None:
        """Raises GapError if a unit is said of a joint that is not there."""
        for key in (k for k in self.units if ":" in k):
            name = key.rpartition(":")[0]
            if not any(same_joint(name, j) for j in joints):
                raise GapError(
                    f"--units {key}: there is no joint {name!r}; there are {some_of(joints)}"
                )

    @property
    def silent(self) -> bool:
        """Whether nothing was said of any signal: what no name says may be guessed."""
        return set(self.columns) <= {"time"}

    @property
    def leaves_motion(self) -> bool:
        """Whether positions and commands are still to be found by what follows what."""
        return set(self.columns) <= {"time", "effort"} and NONE not in map(self.said, self.columns)


@dataclass(frozen=True)
class Pick:
    """A column of a source (its place in the list) that was named for a role."""

    source: int
    role: str
    header: str


def as_named(sources: Sequence[Source], request: Request) -> tuple[list[Source], bool]:
    """Roles as the user named them, the others as found, and whether all joints are still there:
    not if columns of a single joint were named, which is then the only one.

    Raises GapError if a column is missing, or if it is not clear of which joint one is.
    """
    picks = list(_picks(sources, request))
    _contradicted(picks, sources)
    signals = [p for p in picks if p.role != "time"]
    known = _positions(sources)
    of = {p: _named_by(_meaning(p, sources), known) for p in signals}
    if len(known) > 1 and signals and all(of.values()):
        _once_each(of, sources)
        return [_beside(s, k, picks, of, request) for k, s in enumerate(sources)], True
    if any(len(_like(p, signals)) > 1 for p in signals):
        of = _in_order(signals, sources, known)
        return [_instead(s, k, picks, of, request) for k, s in enumerate(sources)], False
    if signals and len(known) > 1 and not {p.role for p in signals} & {"position", "error"}:
        raise GapError(
            f"{_file(sources)}: {signals[0].header!r} (for {signals[0].role}) is of none of the"
            f" joints {some_of(known)}; name a column for each of them"
            f" ({signals[0].role}=HEADER,HEADER,…), or the position of its joint too"
        )
    alone = dict.fromkeys(signals, "")
    made = [_instead(s, k, picks, alone, request) for k, s in enumerate(sources)]
    held = {p.source for p in signals}
    if not known and {p.role for p in signals} == {"effort"}:  # what moves is still to be found
        return made, True
    return [_of_one_joint(s) if k in held else s for k, s in enumerate(made)], not signals


def _positions(sources: Sequence[Source]) -> list[str]:
    """Joints whose positions the headers name."""
    return list(dict.fromkeys(m.joint for s in sources for m in s.meanings if m.role == "position"))


def _file(sources: Sequence[Source]) -> str:
    return sources[0].table.path.name


def _like(pick: Pick, picks: Sequence[Pick]) -> list[Pick]:
    """Those of the same role and source."""
    return [p for p in picks if (p.role, p.source) == (pick.role, pick.source)]


# -- which columns are named ---------------------------------------------------------------------
def _picks(sources: Sequence[Source], request: Request) -> Iterator[Pick]:
    """The columns that were named, in the order in which they were; raises if one is not there."""
    for role in request.columns:
        for said in request.said(role) if request.names(role) else ():
            found = [
                Pick(k, role, header)
                for k, source in enumerate(sources)
                for header in _headers(said, source, len(sources) == 1, role)
            ]
            if not found:
                headers = [h for s in sources for h in s.table.columns]
                raise GapError(
                    f"{_file(sources)}: no column {said!r} (for {role}); it has {some_of(headers)}"
                )
            yield from found


def _headers(said: str, source: Source, alone: bool, role: str) -> list[str]:
    """Headers of a source that something said of a role means: one, a list or a range of them."""
    headers = list(source.table.columns)
    if said in headers:
        return [said]
    items = [i.strip() for i in re.split(r",(?![^\[\](){}]*[\]\)}])", said)]
    found = [_item(item, source, alone, role) for item in items if item]
    lacking = [i for i, f in zip(filter(None, items), found, strict=True) if not f]
    if any(found) and lacking:
        raise GapError(
            f"{source.table.path.name}: no column {lacking[0]!r} (for {role}); it has"
            f" {some_of(headers)}"
        )
    return list(dict.fromkeys(h for f in found for h in f))


def _item(item: str, source: Source, alone: bool, role: str) -> list[str]:
    headers = list(source.table.columns)
    numbered = alone or source.table.headless
    if found := _one(item, headers, numbered):
        return [found]
    if array := [h for h in headers if h.startswith(f"{item}[")]:
        return array
    for k in (k for k, c in enumerate(item) if c == "-"):
        first, last = (_one(x.strip(), headers, numbered) for x in (item[:k], item[k + 1 :]))
        if first and last:
            a, b = headers.index(first), headers.index(last)
            if a > b:
                raise GapError(f"--columns {role}={item}: {last} comes before {first}")
            return headers[a : b + 1]
    return _group(item, source, role)


def _one(item: str, headers: Sequence[str], numbered: bool) -> str:
    """The one header that a name or a number says, or ""."""
    if item in headers:
        return item
    if not item.isdecimal() or not numbered:
        return ""
    if f"column{int(item)}" in headers:
        return f"column{int(item)}"
    return headers[int(item)] if int(item) < len(headers) else ""


def _group(stem: str, source: Source, role: str) -> list[str]:
    """Headers of which a stem leaves nothing but the joint; of two the shorter. Raises if it leaves
    one joint twice.
    """
    words = tokens(stem)
    of: dict[str, list[tuple[int, str]]] = {}
    for header in source.table.columns if words else ():
        own = tokens(header)
        at = next((k for k in range(len(own)) if own[k : k + len(words)] == words), -1)
        rest = [] if at < 0 else own[:at] + own[at + len(words) :]
        joint = " ".join(_numbered(w) for w in rest if w not in FILLERS)
        if joint:
            of.setdefault(joint, []).append((len(rest), header))
    for joint, found in of.items():
        shortest = [h for n, h in found if n == min(found)[0]]
        if len(shortest) > 1:
            _twice(role, joint, shortest, source)
    return [min(found)[1] for found in of.values()]


def _numbered(word: str) -> str:
    """A word as names of joints have it: `01` is 1."""
    return str(int(word)) if word.isdecimal() else word


def _twice(role: str, joint: str, headers: Sequence[str], source: Source) -> None:
    raise GapError(
        f"{source.table.path.name}: {' and '.join(headers)} were named for the {role} of joint"
        f" {joint}; say which"
    )


def _contradicted(picks: Sequence[Pick], sources: Sequence[Source]) -> None:
    roles: dict[tuple[int, str], str] = {}
    for p in picks:
        other = roles.setdefault((p.source, p.header), p.role)
        if other != p.role:
            raise GapError(
                f"{_file(sources)}: {p.header} was named for {other} and for {p.role};"
                " --columns takes one role for each column"
            )


# -- which joints they are of ----------------------------------------------------------------------
def _meaning(pick: Pick, sources: Sequence[Source]) -> Meaning:
    return next(m for m in sources[pick.source].meanings if m.header == pick.header)


def _named_by(m: Meaning, joints: Sequence[str]) -> str:
    if m.joint in joints:
        return m.joint
    words = {_numbered(w) for w in tokens(m.header)}
    held = sorted(
        (j for j in joints if j and set(j.split()) <= words), key=lambda j: len(j.split())
    )
    clear = held and (len(held) == 1 or len(held[-1].split()) > len(held[-2].split()))
    return held[-1] if clear else ""


def _once_each(of: Mapping[Pick, str], sources: Sequence[Source]) -> None:
    there: dict[tuple[int, str, str], Pick] = {}
    for p, joint in of.items():
        other = there.setdefault((p.source, p.role, joint), p)
        if other is not p:
            _twice(p.role, joint, [other.header, p.header], sources[p.source])


def _in_order(
    signals: Sequence[Pick], sources: Sequence[Source], known: Sequence[str]
) -> dict[Pick, str]:
    """The joint of each column of lists: by the names in its header, else the first joint comes
    first. Raises if a list is of more or fewer joints than the positions.
    """
    roles = list(dict.fromkeys(p.role for p in signals))
    first = "position" if "position" in roles else ("" if len(known) > 1 else roles[0])
    joints = list(known)
    of: dict[Pick, str] = {}
    for role in sorted(roles, key=lambda r: r != first):
        for k in dict.fromkeys(p.source for p in signals if p.role == role):
            own = [p for p in signals if (p.role, p.source) == (role, k)]
            if role == first:
                joints = _own_names(own, sources)
                of.update(zip(own, joints, strict=True))
                continue
            names = [_named_by(_meaning(p, sources), joints) for p in own]
            by_name = not sources[k].table.headless and all(names)
            if not by_name and len(own) != len(joints):
                raise GapError(
                    f"{_file(sources)}: {len(own)} column(s) were named for {role}"
                    f" ({some_of([p.header for p in own])}) beside {len(joints)} joints; name one"
                    " for each joint, in their order"
                )
            if by_name:
                _once_each(dict(zip(own, names, strict=True)), sources)
            of.update(zip(own, names if by_name else joints, strict=True))
    return of


def _own_names(own: Sequence[Pick], sources: Sequence[Source]) -> list[str]:
    """Names of the joints of a list: what tells its headers apart, else 1 to n."""
    headless = sources[own[0].source].table.headless
    said = [_meaning(p, sources).joint.split() for p in own]
    shared = set.intersection(*map(set, said)) if len(said) > 1 else set()
    names = [" ".join(w for w in words if w not in shared) for words in said]
    if headless or not all(names) or len(set(names)) < len(names):
        return [str(k + 1) for k in range(len(own))]
    return names


# -- what the columns then mean ----------------------------------------------------------------
def _as(m: Meaning, role: str, joint: str) -> Meaning:
    quantity, command = ("position", True) if role == "command" else (role, False)
    return replace(m, quantity=quantity, command=command, joint=joint, rank=NAMED)


def _same_role(m: Meaning, role: str) -> bool:
    return m.role == role or (role == "effort" and m.role == "command effort")


def _unused(m: Meaning) -> Meaning:
    return replace(m, quantity="other", command=False)


def _beside(
    source: Source, place: int, picks: Sequence[Pick], of: Mapping[Pick, str], request: Request
) -> Source:
    """The picked columns instead of those of the same joint and role."""
    mine = {p.header: p for p in picks if p.source == place}
    whole = [r for r in request.columns if r == "time" or not request.names(r)]
    made = []
    for m in source.meanings:
        if p := mine.get(m.header):
            made.append(_as(m, p.role, of.get(p, "")))
        elif any(_same_role(m, role) for role in whole):
            made.append(_unused(m))
        else:
            joints = {j for p, j in of.items() if _same_role(m, p.role)}
            made.append(_unused(m) if _named_by(m, [*joints]) else m)
    return replace(source, meanings=tuple(made))


def _instead(
    source: Source, place: int, picks: Sequence[Pick], of: Mapping[Pick, str], request: Request
) -> Source:
    """The picked columns instead of all others of their roles."""
    mine = {p.header: p for p in picks if p.source == place}
    made = []
    for m in source.meanings:
        if p := mine.get(m.header):
            made.append(_as(m, p.role, of.get(p, "")))
        else:
            named = any(_same_role(m, role) for role in request.columns)
            made.append(_unused(m) if named else m)
    return replace(source, meanings=tuple(made))


def _of_one_joint(source: Source) -> Source:
    """A source of which the columns of a single joint were named: others are not its own."""
    apart = {"time", "other", "episode"}
    made = (
        m if m.rank == NAMED or m.role in apart else replace(m, joint="", rank=m.rank + BEHIND)
        for m in source.meanings
    )
    return replace(source, meanings=tuple(made))
