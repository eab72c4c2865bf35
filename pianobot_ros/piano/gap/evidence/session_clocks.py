"""Clocks of a cell's devices in one running session.

How much a clock gains on the host's is a property of the device: a diagnosis finds it, and it holds
in any session. By how much the clock is ahead at a moment is a state of the session: nothing but
the session's own stamps tells it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache

from pianobot_ros.cell.numbers.config import Section, load_section, quantity
from pianobot_ros.cell.recordings.recording import Recording

__all__ = [
    "CLOCKS",
    "MARGIN",
    "SessionClocks",
    "ahead_at",
    "ahead_of",
    "least_lags",
    "set_right",
]

CLOCKS = {
    "real/wrist/state": "wrist",
    "real/vacuum/state": "vacuum",
    "real/fsr": "fsr",
    "real/key_angle": "fsr",
}
"""Whose clock stamps a signal."""
SIGHTS = 3
"""How many sights are kept: the one that came with the least delay counts."""
LOOK = 2.0  # s at the start of a recording in which clocks are looked at
ALLOWED = 2e-3  # s: the constant errors of stamps that are fitted anyway (link.yaml)
MARGIN = 1.2  # s before the first strike at which a recording starts
OF_ANOTHER_TIME = 60.0  # s between stamp and sending: no clock that runs with the host's
RESTARTED = 0.02  # s between what is seen and what the rate says: the device began anew


class Lag(Section):
    """``config/link.yaml``: smallest time from a device's stamp to the publication of what it
    measured.
    """

    wrist: float = quantity("s", low=0, high=0.1)
    vacuum: float = quantity("s", low=0, high=0.1)
    fsr: float = quantity("s", low=0, high=0.1)


@cache
def least_lags() -> dict[str, float]:
    """By device that sends a stream, the smallest time from its stamps to publication, s. Notes are
    stamped by the host.
    """
    lag = load_section("link.yaml", Lag, "lag")
    return {"wrist": lag.wrist, "vacuum": lag.vacuum, "fsr": lag.fsr}


def ahead_of(
    device: str, sights: Iterable[tuple[int, float]], now: int, rate: float = 0.0
) -> float:
    """How far the clock of ``device`` is ahead at ``now`` (ns), s: by that one of the ``sights``
    (when it was sent, ns; stamp less that, s) that came with the least delay. The clock gains
    ``rate``.
    """
    return max(x + 1e-9 * (now - sent) * rate for sent, x in sights) + least_lags()[device]


def ahead_at(sights: Mapping[str, Iterable[tuple[int, float]]], start: float) -> dict[str, float]:
    """By how much, s, the clocks of devices were ahead at ``start`` s: a state of the session. What
    the diagnosis allows for anyway counts as nothing. ``sights`` by device as in :func:`ahead_of`.
    """
    found = {}
    for device, seen in sights.items():
        near = [
            s for s in seen if start <= 1e-9 * s[0] <= start + LOOK and abs(s[1]) < OF_ANOTHER_TIME
        ]
        if near and device in least_lags():
            ahead = ahead_of(device, near, near[0][0])
            found[device] = ahead if abs(ahead) > ALLOWED else 0.0
    return found


def set_right(recording: Recording) -> Recording:
    """The recording with every device's clock set right shortly before its first strike, by its
    ``sights``: what a board that was started long ago has gained by then is no gap of this phrase.
    """
    if not recording.sights or not recording.strikes:
        return recording
    devices: dict[str, list[tuple[int, float]]] = {}
    for topic, seen in recording.sights.items():
        if topic in CLOCKS:
            devices.setdefault(CLOCKS[topic], []).extend(seen)
    first = min(s.start for s in recording.strikes)
    ahead = ahead_at(devices, recording.epoch + first - MARGIN)
    signals = {}
    for name, x in recording.signals.items():
        off = ahead.get(CLOCKS.get(name.split(".")[0], ""), 0.0)
        signals[name] = replace(x, time=x.time - off) if off else x
    return replace(recording, signals=signals, sights={})


class SessionClocks:
    """Stamps that the twin gives in place of its devices: of the host's clock, until a device is
    said to gain on it (:meth:`follow`) and was seen (:meth:`observe`).
    """

    def __init__(self) -> None:
        self._seen: dict[str, deque[tuple[int, float]]] = {}
        self._rates: dict[str, float] = {}
        self._ahead: dict[str, tuple[int, float]] = {}

    def follow(self, skews: Mapping[str, float], since: int | None = None) -> None:
        """From now on devices gain by ``skews`` (by name: share of the stamps' own time; devices
        that are left out do not). ``since``: all of them showed the host's time then, ns since the
        epoch; None: their offsets are what was seen of them.
        """
        self._rates = {d: k / (1.0 - k) for d, k in skews.items() if k}
        self._ahead = {} if since is None else dict.fromkeys(self._rates, (since, 0.0))
        for device in self._seen:
            self._settle(device)

    def observe(self, device: str, stamp: int, sent: int) -> None:
        """A real device gave the stamp ``stamp`` to what was sent at ``sent``, both ns since the
        epoch; of a second's messages the one that came with the least delay.
        """
        ahead = 1e-9 * (stamp - sent)
        if abs(ahead) < OF_ANOTHER_TIME:
            self._seen.setdefault(device, deque(maxlen=SIGHTS)).append((sent, ahead))
            self._settle(device)

    def _settle(self, device: str) -> None:
        seen, rate = self._seen[device], self._rates.get(device)
        if rate is None or len(seen) < SIGHTS or device not in least_lags():
            return
        last = seen[-1][0]
        ahead = ahead_of(device, seen, last, rate)
        if device not in self._ahead or abs(ahead - self.ahead(device, last)) > RESTARTED:
            self._ahead[device] = last, ahead

    def ahead(self, device: str, now: int) -> float:
        """How far the device's clock is ahead of the host's at ``now`` (ns since the epoch), s."""
        known = self._ahead.get(device)
        if known is None:
            return 0.0
        return known[1] + 1e-9 * (now - known[0]) * self._rates[device]

    def stamp(self, device: str, now: int) -> int:
        """Stamp, ns since the epoch, that the device gives to what happens at ``now``."""
        return now + round(1e9 * self.ahead(device, now))
