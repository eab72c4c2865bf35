"""A door of the package, as the fuzzer sees it."""

from __future__ import annotations

import random
from abc import ABC, abstractmethod

__all__ = ["INTEGERS", "NUMBERS", "OutOfLimitsError", "Target", "changed", "number"]

INTEGERS: tuple[int, ...] = (0, 1, -1, 127, 128, 255, 256, 4095, 4096, 65535, 65536)
INTEGERS += (2**31 - 1, 2**31, 2**32 - 1, 2**32, -(2**31), 2**63, 10**12)
NUMBERS: tuple[float, ...] = (0.0, -0.0, 1.0, -1.0, 1e-320, 1e-9, 1e3, -1e9, 1e15, 1e200, -1e308)
NUMBERS += (float("inf"), float("-inf"), float("nan"))


class OutOfLimitsError(Exception):
    """Something was accepted that must not be."""


class Target(ABC):
    """One door. ``feed`` gets one input; whatever it raises is a crash, but OutOfLimitsError."""

    name = ""
    cost = 1
    """How many times fewer frames it gets: those that need a file take longer."""
    inside = 1
    """Number of hostile frames in the last input: messages of a recording, cells of a table."""

    @abstractmethod
    def make(self, rng: random.Random) -> bytes:
        """One hostile input, with correct checksums where the format has any."""

    @abstractmethod
    def feed(self, data: bytes) -> bool:
        """Take it in; False if it was refused."""

    def close(self) -> None:  # noqa: B027 (most hold nothing)
        """Give back what the target holds."""


def changed(data: bytes, rng: random.Random, most: int = 6) -> bytes:
    """``data`` with some bytes flipped, replaced, repeated, cut out or cut off."""
    made = bytearray(data)
    for _ in range(rng.randint(1, most)):
        if not made:
            break
        at, length = rng.randrange(len(made)), rng.choice((1, 1, 2, 4, 8, 64))
        match rng.randrange(6):
            case 0:
                made[at] ^= 1 << rng.randrange(8)
            case 1:
                made[at : at + length] = bytes(
                    rng.choice((0, 127, 128, 255)) for _ in range(length)
                )
            case 2:
                made[at : at + length] = rng.randbytes(length)
            case 3:
                del made[at : at + length]
            case 4:
                made[at:at] = made[at : at + length] * rng.randint(1, 4)
            case _:
                del made[rng.randrange(len(made)) :]
    return bytes(made)


def number(rng: random.Random) -> float:
    """A number that somebody may not have thought of."""
    if rng.random() < 0.7:
        return rng.choice(NUMBERS)
    return rng.uniform(-1.0, 1.0) * 10.0 ** rng.randint(-12, 12)
