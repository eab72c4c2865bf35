"""How far a log is smoothed, and where something outside pushed: both by asking how much of the
acceleration stands in the measured effort.

An acceleration is the position differentiated twice, so that its noise grows with the square of the
frequency. Noise in a regressor draws its coefficient towards zero: where it is most of what the
acceleration has beside speed, friction and gravity, inertia is lost, and with it gravity, which it
balances in a free swing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.signals.filtering import derivative, low_pass
from pianobot_ros.gap.problem.types import Array

__all__ = ["Smoothing", "smoothing"]

NOISE = 0.5
"""Share of the acceleration below which most of it is noise: a Wiener filter would cut there."""
ENOUGH = 0.9
"""The same with which inertia comes out within a tenth."""
LOWER = 2.0 ** -np.arange(0.5, 3.1, 0.5)
"""Lower cuts that are tried, relative to the first one."""
SLOW = 0.03
"""Of the RMS speed; the direction of friction is not certain below."""
PIECE = 0.5
"""s; pieces of the log that agree, or not."""
KEPT = 0.8
"""Share of the pieces that have to agree."""
STARTS, STEPS = 20, 6
"""Random halves from which agreement is looked for, and rounds of refitting for each."""
SPOILT = 4.0
"""Factor on the squared residual of all else by which it shows that a push is fitted, too."""
BRIEF = 0.1
"""Share of the time above which a push is no exception."""


@dataclass(frozen=True)
class Smoothing:
    """A cut (Hz); which share of the acceleration the effort tells; and where on the grid (n,)
    something outside pushed harder than the motor ever did, by at most `push` (effort).
    """

    cutoff: float
    share: float
    pushed: NDArray[np.bool_]
    push: float = 0.0


def smoothing(
    position: Array, effort: Array, dt: float, cutoff: float, valid: NDArray[np.bool_]
) -> Smoothing:
    """How a log on an even grid (n,), measured where it is `valid`, is smoothed.

    At `cutoff` Hz; where most of the acceleration is noise at that, at the highest lower cut with
    which inertia comes out within a tenth, or with which it comes out best.

    The share is the squared partial correlation of acceleration and effort beside speed, direction,
    gravity and a constant. It is the ratio of two inertias, too: of that which regression of effort
    on acceleration gives, drawn down by the acceleration's noise, to that of the opposite
    regression, drawn up by whatever else is in the effort.
    """
    best = first = _judged(position, effort, dt, cutoff, valid)
    for lower in LOWER if first.share < NOISE else ():
        tried = _judged(position, effort, dt, cutoff * float(lower), valid)
        best = tried if tried.share > best.share else best
        if best.share >= ENOUGH:
            break
    return best if best.share >= NOISE else first


def _judged(
    position: Array, effort: Array, dt: float, cutoff: float, valid: NDArray[np.bool_]
) -> Smoothing:
    q, felt = low_pass(position, dt, cutoff), low_pass(effort, dt, cutoff)
    v = derivative(q, dt)
    slow = SLOW * float(np.sqrt(np.mean(v**2))) + 1e-12
    turn = low_pass(np.tanh(v / slow), dt, cutoff)
    x = np.stack([derivative(v, dt), v, turn, np.sin(q), np.cos(q), np.ones(q.size)], axis=1)
    x /= np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    nowhere = np.zeros(q.size, bool)
    edge = min(round(PIECE / dt), q.size // 4)
    moves = valid & (np.abs(v) > slow)
    moves[:edge] = moves[q.size - edge :] = False
    use = np.flatnonzero(moves)[:: max(1, round(1.0 / (4.0 * cutoff * dt)))]
    if use.size < 10 * x.shape[1]:
        return Smoothing(cutoff, 1.0, nowhere)
    pieces = _Pieces(x[use], felt[use], (use * dt / PIECE).astype(int))
    most = float(np.max(np.abs(effort)))
    off = np.abs(x @ pieces.solved(pieces.agreeing()) - felt)
    beyond = np.isin(pieces.names, (use[off[use] > most] * dt / PIECE).astype(int))
    if beyond.any() and pieces.spoilt(beyond):
        off = np.abs(x @ pieces.solved(~beyond) - felt)
        pushed = _grown(moves & (off > most), off > 3.0 * pieces.rms(~beyond))
        if pushed.any() and pushed.mean() < BRIEF:
            return Smoothing(cutoff, pieces.share(~beyond), pushed, float(np.max(off[pushed])))
    return Smoothing(cutoff, pieces.share(np.ones(beyond.size, bool)), nowhere)


def _grown(core: NDArray[np.bool_], around: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Stretches (n,) of `around` that hold samples of `core`."""
    label = np.cumsum(np.diff(np.concatenate([[0], around.astype(int)])) > 0)
    return np.asarray(around & np.isin(label, np.unique(label[core & around])), bool)


class _Pieces:
    """Least squares over pieces of a log, by their sums of products alone."""

    def __init__(self, x: Array, y: Array, piece: NDArray[np.intp]) -> None:
        """Regressors (m, k), the first of them the acceleration, and effort (m,)."""
        self.names, first = np.unique(piece, return_index=True)
        z = np.column_stack([x, y])
        products = (z[:, :, None] * z[:, None, :]).reshape(len(z), -1)
        shape = (-1, z.shape[1], z.shape[1])
        self.products = np.add.reduceat(products, first, axis=0).reshape(shape)
        self.count = np.diff([*first, len(z)])

    def solved(self, use: NDArray[np.bool_] | NDArray[np.intp]) -> Array:
        """Coefficients (k,) by the pieces `use`."""
        total = self.products[use].sum(0)
        return np.asarray(np.linalg.lstsq(total[:-1, :-1], total[:-1, -1], rcond=1e-9)[0])

    def left(self, beta: Array) -> Array:
        """Squared residual of each piece."""
        w = np.append(beta, -1.0)
        return np.asarray(np.maximum(np.einsum("i,pij,j->p", w, self.products, w), 0.0))

    def rms(self, use: NDArray[np.bool_]) -> float:
        """RMS residual of the pieces `use` by their own fit."""
        return float(np.sqrt(self.left(self.solved(use))[use].sum() / self.count[use].sum()))

    def agreeing(self) -> NDArray[np.intp]:
        """The pieces that leave least by a fit to themselves (least trimmed squares): what stands
        apart there cannot draw the fit to itself, however large it is.
        """
        rng = np.random.default_rng(0)
        many = self.names.size
        least, best = np.inf, np.arange(many)
        for start in range(STARTS):
            use = np.arange(many) if start == 0 else rng.choice(many, max(many // 2, 1), False)
            for _ in range(STEPS):
                left = self.left(self.solved(use))
                use = np.argsort(left, kind="stable")[: int(np.ceil(KEPT * many))]
            if left[use].sum() < least:
                least, best = float(left[use].sum()), use
        return best

    def spoilt(self, beyond: NDArray[np.bool_]) -> bool:
        """Whether the other pieces fit much worse if those `beyond` are fitted with them."""
        alone, together = self.solved(~beyond), self.solved(np.ones(beyond.size, bool))
        return bool(self.left(together)[~beyond].sum() > SPOILT * self.left(alone)[~beyond].sum())

    def share(self, use: NDArray[np.bool_]) -> float:
        """Squared partial correlation of the first regressor and the effort; 0 where the
        acceleration goes against the effort.
        """
        total = self.products[use].sum(0)
        rest, own = total[1:-1, 1:-1], total[[0, -1]]
        both = own[:, [0, -1]] - own[:, 1:-1] @ np.linalg.lstsq(rest, own[:, 1:-1].T, rcond=1e-9)[0]
        if both[0, 1] <= 0.0:
            return 0.0
        return float(both[0, 1] ** 2 / max(both[0, 0] * both[1, 1], 1e-300))
