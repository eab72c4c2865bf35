"""A twin of a dozen lines: a scaled, possibly late input, and a force that follows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.gap import Block, Effect, Observable, Parameter, Signal, Stage


class Toy:
    stages = (Stage("motion"), Stage("force"))
    observables = (
        Observable("x", "motion", "x", "m"),
        Observable("f", "force", "f", "N", mode="inverse"),
        Observable("onset", "motion", "onset", "s", kind="event", floor_hint=1e-3),
    )
    parameters = (
        Parameter("k", 1.0, 0.2, 5.0, stage="motion", sd=0.2, log=True),
        Parameter("c", 0.5, 0.05, 5.0, "N/m", "force", sd=0.2, log=True),
    )
    effects = (
        Effect(
            "friction",
            "force",
            (Parameter("fc", 0, -2, 2, "N", sd=0.3),),
            ({"fc": 0.1}, {"fc": 0.5}),
        ),
        Effect(
            "delay",
            "motion",
            (Parameter("d", 0, 0, 0.2, "s", sd=0.03),),
            ({"d": 0.01}, {"d": 0.05}),
        ),
        Effect(
            "cubic",
            "force",
            (Parameter("c3", 0, -5, 5, "N/m³", sd=0.5),),
            ({"c3": 0.1}, {"c3": -0.5}),
        ),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ):
        out = []
        for b in blocks:
            u = b.inputs["u"]
            late = values["d"] if "delay" in effects else 0.0
            prediction = {"x": values["k"] * np.interp(u.t - late, u.t, u.y), "onset": 0.3 + late}
            if "x" in b.outputs:
                x = b.outputs["x"]
                y = np.nan_to_num(x.y)
                f = values["c"] * y
                if "friction" in effects:
                    f = f + values["fc"] * np.tanh(np.gradient(y, np.arange(y.size) * 0.01) / 0.05)
                if "cubic" in effects:
                    f = f + values["c3"] * y**3
                prediction["f"] = f
            out.append(prediction)
        return out


def recordings(
    seed=1, n=12, *, k=1.0, c=0.5, fc=0.0, d=0.0, c3=0.0, odd=0.0, start=0.0, conditions=3
) -> list[Block]:
    """Blocks of an independent "robot": sign friction, exact delay; `odd` is a force that the
    library lacks.
    """
    rng = np.random.default_rng(seed)
    out = []
    for i in range(n):
        w = 1 + i % conditions
        t = np.arange(0, 4, 0.01)
        clean = k * np.sin(w * (t - d)) * (t > d)
        v = k * w * np.cos(w * (t - d))
        force = c * clean + fc * np.sign(v) + c3 * clean**3 + odd * np.sin(8 * clean)
        x = clean + 0.002 * rng.normal(size=t.size)
        f = force + 0.02 * rng.normal(size=t.size) + 0.01 * rng.normal()
        out.append(
            Block(
                f"b{i}",
                f"w{w}",
                {"u": Signal(t + start, np.sin(w * t), "m")},
                {"x": Signal(t + start, x, "m"), "f": Signal(t + start, f, "N")},
                {"onset": 0.3 + d + 0.001 * rng.normal()},
                {"early": (start, start + 2.0), "late": (start + 2.0, start + 4.0)},
                {"rate": float(w)},
            )
        )
    return out
