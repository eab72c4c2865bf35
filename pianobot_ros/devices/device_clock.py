"""Host time of a sample from the microcontroller's clock."""

from __future__ import annotations

from typing import Literal

__all__ = ["DeviceClock"]

_WRAP = 1 << 32
_SETTLE = 1.0  # s over which the offset is found
_BLOCK = 5.0  # s for which one smallest delay is kept when the drift is tracked
_JUMP = 0.5  # s of disagreement that may mean a restarted device
_HELD_UP = 1.0  # s of arrivals that are all so late: what a stall delayed comes at once


class DeviceClock:
    """Maps 32-bit microseconds of the device to host nanoseconds.

    A line can be late (driver, scheduler) but never early, so the offset between the clocks is the
    smallest difference between arrival and device time. ``fixed`` finds it in the first second
    after the connection and keeps it: intervals are then those of the device's crystal. ``tracked``
    follows it in blocks of a few seconds, which removes the drift of the crystal (20 to 50 ppm) but
    moves stamps by as much. ``arrival`` ignores the device's clock.

    A device that restarted is ahead of its own clock (its counter wraps), or stays behind it; lines
    that this machine was too busy to read are late too, but only until they are read.
    """

    def __init__(self, mode: Literal["fixed", "tracked", "arrival"] = "fixed") -> None:
        self.mode = mode
        self.reset()

    def reset(self) -> None:
        """Start afresh, as after a reconnection."""
        self._last: int | None = None
        self._device_us = 0
        self._first_us = 0
        self._offset_ns: int | None = None
        self._block_start_us = 0
        self._block_min: int | None = None
        self._late_since_ns: int | None = None
        self.own_ns = 0
        """The last sample's time by the clock that took it, ns since some moment: intervals by it
        are free of what the offset was corrected by meanwhile."""

    def host_ns(self, device_us: int, arrival_ns: int) -> int:
        """Host time, ns since the epoch, of the sample taken at ``device_us`` (wraps at 2^32)."""
        if self.mode == "arrival":
            self.own_ns = arrival_ns
            return arrival_ns
        if self._last is None:
            self._device_us = self._first_us = self._block_start_us = device_us
        else:
            self._device_us += (device_us - self._last) % _WRAP
        self._last = device_us
        self.own_ns = 1000 * self._device_us
        difference = arrival_ns - 1000 * self._device_us
        offset = self._offset_ns
        if offset is not None and self._is_another(difference - offset, arrival_ns):
            self.reset()
            return self.host_ns(device_us, arrival_ns)
        if offset is None or (
            difference < offset and self._device_us - self._first_us < _SETTLE * 1e6
        ):
            self._offset_ns = difference
        if self.mode == "tracked":
            self._track(difference)
        assert self._offset_ns is not None
        return 1000 * self._device_us + self._offset_ns

    def _is_another(self, late_ns: int, arrival_ns: int) -> bool:
        """Whether the device's clock is no longer the one whose offset is known."""
        if late_ns <= _JUMP * 1e9:
            self._late_since_ns = None
            return late_ns < -_JUMP * 1e9
        if self._late_since_ns is None:
            self._late_since_ns = arrival_ns
        return arrival_ns - self._late_since_ns > _HELD_UP * 1e9

    def _track(self, difference: int) -> None:
        self._block_min = (
            difference if self._block_min is None else min(difference, self._block_min)
        )
        if self._device_us - self._block_start_us >= _BLOCK * 1e6:
            self._offset_ns, self._block_min = self._block_min, None
            self._block_start_us = self._device_us
