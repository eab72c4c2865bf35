"""A joint that follows its command, and its log as laboratories write it."""

from __future__ import annotations

import numpy as np

N = 300
T = np.arange(N) * 0.02
Q = 0.6 * np.sin(2.1 * T) + 0.2
U = 0.6 * np.sin(2.1 * T + 0.1) + 0.2
V = np.gradient(Q, T)
TAU = 0.3 * np.gradient(V, T) + 0.2 * np.sign(V)
SECOND = 0.5


def table(path, columns, delimiter=",", comma=False, header=True):
    rows = [delimiter.join(columns)] if header else []
    for cells in zip(*columns.values(), strict=True):
        texts = [c if isinstance(c, str) else f"{c:.15g}" for c in cells]
        rows.append(delimiter.join(t.replace(".", ",") if comma else t for t in texts))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def check(log, *, command=True, velocity=False, effort=False, tolerance=1e-5):
    assert np.allclose(log.position, Q[: log.position.size], atol=tolerance)
    assert np.allclose(log.t, T[: log.t.size], atol=2e-3)
    assert (log.command is not None) == command
    if command:
        assert np.allclose(log.command, U[: log.t.size], atol=tolerance)
    assert (log.velocity is not None) == velocity
    if velocity:
        assert np.allclose(log.velocity, V[: log.t.size], atol=max(1e-3, tolerance))
    assert (log.effort is not None) == effort
