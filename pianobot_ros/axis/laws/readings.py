"""What the laws say of a motion that was measured and smoothed.

What is quicker than the smoothing is not in the smoothed signals, so it must not be in a prediction
either. Torque and encoder errors that repeat with position are quick at speed: they are taken at
the position as it was read, and smoothed like the measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.laws.drive import cogging
from pianobot_ros.axis.laws.sensing import encoder_ripple
from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.axis.signals.filtering import derivative, low_pass
from pianobot_ros.gap.problem.types import Array

__all__ = ["Motion", "Moved", "Readings"]

Motion = tuple[Array, Array, Array]
"""Angle, speed and acceleration (n,)."""


@dataclass(frozen=True)
class Readings:
    """Readings of a joint's position (n,), each `dt` s; `smoothed` at `cutoff` Hz, with slopes."""

    raw: Array
    smoothed: Motion
    dt: float
    cutoff: float
    ahead: Array | None = None
    """By how much (n,) they are ahead of the readings behind gear and spring, smoothed."""

    @classmethod
    def of(cls, c: Clean) -> Readings:
        """Those of a whole log."""
        return cls(c.position, (c.q, c.v, c.a), c.dt, c.cutoff, c.twist)

    def moved(self, p: Array) -> Moved:
        """What they say with the parameters `p` (see `kernel.NAMES`)."""
        return Moved(self, p, self._motion(p), self._cogging(p))

    def even(self, y: Array) -> Array:
        """A signal (n,) smoothed like them."""
        return low_pass(y, self.dt, self.cutoff)

    def _motion(self, p: Array) -> Motion:
        q, v, a = self.smoothed
        q = q - p[kernel.PO]
        if p[kernel.ER] != 0.0:
            ripple = (p[kernel.ER], p[kernel.EW], p[kernel.EPH])
            q, v, a = encoder_ripple.undone(self.raw - p[kernel.PO], (q, v, a), ripple, self.even)
        if p[kernel.EP] > kernel.STIFF and p[kernel.EO] != 0.0:
            q, v, a = _at_motor(q, v, a, self.dt, p)
        return q, v, a

    def _cogging(self, p: Array) -> Array | float:
        if p[kernel.COG] == 0.0:
            return 0.0
        wave = p[kernel.COG], p[kernel.COGW], p[kernel.COGP]
        return self.even(cogging.along(self.raw - p[kernel.PO], *wave))


@dataclass(frozen=True)
class Moved:
    """How the motor moved by its readings with the parameters `p`: without the encoder's offset and
    ripple, and without the twist of a spring that the encoder sits behind; and the torque of
    `cogging` (n,) that is in the smoothed effort.
    """

    readings: Readings
    p: Array
    motion: Motion
    cogging: Array | float

    @property
    def erring(self) -> Array:
        """What the encoder reads too much (n,), smoothed."""
        q = self.readings.smoothed[0]
        return np.asarray(q - self.p[kernel.PO] - self.motion[0])

    def needed(self, field: Array, felt: Array) -> Array:
        """Effort (n,) that the motion needs where `felt` (n,) was measured, before droop and
        latency. `field` is what other joints add (see `kernel.forward`).
        """
        return self._asked(field, felt)[0]

    def compared(self, field: Array, felt: Array, pieces: tuple[int, int]) -> tuple[Array, Array]:
        """`needed`, and the readings (n,) that follow from the effort that was `felt` (n,), started
        anew from the motion in `pieces` (length, first) of samples.
        """
        q, v, _ = self.motion
        p, load = self.motor_alone
        needed, bent = self._asked(field, felt)
        acts, dt = felt - self.cogging - load, self.readings.dt
        return needed, np.asarray(kernel.horizon(q, v, bent, acts, dt, pieces, p, field))

    def _asked(self, field: Array, felt: Array) -> tuple[Array, Array]:
        """What `needed` says, and how far the contact of dry friction is bent (n,)."""
        left = felt - self.cogging
        p, load = self.motor_alone
        even, rough, bent = kernel.inverse(*self.motion, self.readings.dt, p, field, left - load)
        rest = self.readings.even(rough) if np.any(rough) else 0.0
        return np.asarray(even + load + rest + self.cogging), bent

    def twist(self, field: Array) -> Array:
        """By how much (n,) the motor's readings are ahead of the link's, where both were measured:
        a spring by what the link's motion asks of it, a gap by how the motor's carries the link
        along.
        """
        (q, v, _), p, dt = self.motion, self.p, self.readings.dt
        twist = np.zeros(q.size)
        if p[kernel.EP] > kernel.STIFF:
            w, (speed, bend) = 2.0 * math.pi / p[kernel.EP], self.twisting
            pulled = self.motion[2] - bend + kernel.borne(q, p, field)
            twist = (pulled - 2.0 * p[kernel.ED] * w * speed) / (w * w)
        elif kernel.shared(p) > 0.0:
            twist = kernel.crossed(q, v, dt, p, field)
        return np.asarray(twist + self.erring + p[kernel.LO] + p[kernel.LL] * v)

    @cached_property
    def twisting(self) -> tuple[Array, Array]:
        """Speed and acceleration (n,) of the twist, as it was measured."""
        assert self.readings.ahead is not None
        late = self.readings.ahead - self.erring - self.p[kernel.LL] * self.motion[1]
        speed = derivative(late, self.readings.dt)
        return speed, derivative(speed, self.readings.dt)

    @cached_property
    def motor_alone(self) -> tuple[Array, Array | float]:
        """The parameters of the motor without what hangs on its spring or in its gap, and the
        effort (n,) that the acceleration and the friction of that take, where it was measured: no
        law of what is between them is needed then. Else the joint's own, and nothing.
        """
        p, share = self.p, kernel.shared(self.p)
        if self.readings.ahead is None or share == 0.0:
            return p, 0.0
        pulled = self.motion[2] - self.twisting[1]
        alone, total = p.copy(), p[kernel.J] + p[kernel.PJ]
        alone[kernel.EP] = alone[kernel.BL] = alone[kernel.PJ] = 0.0
        alone[kernel.J] = (1.0 - share) * total
        load = share * total * pulled
        if (loose := kernel.behind(p)) > 0.0:
            link = self.motion[1] - self.twisting[0]
            dry = p[list(kernel.LEVELS)].sum()
            load = load + loose * dry * np.tanh(link / max(p[kernel.VS], p[kernel.RS]))
            alone[list(kernel.DRY)] *= 1.0 - loose
        return alone, load


def _at_motor(q: Array, v: Array, a: Array, dt: float, p: Array) -> Motion:
    """The motor's motion where the encoder sits behind the spring of an elastic joint: ahead of
    what was measured by the twist that pulls the load. Its damping is taken to the first order.
    """
    w = 2.0 * math.pi / p[kernel.EP]
    twist = p[kernel.EO] * (a - 2.0 * p[kernel.ED] / w * np.gradient(a, dt)) / (w * w)
    speed = np.gradient(twist, dt)
    return q + twist, v + speed, a + np.gradient(speed, dt)
