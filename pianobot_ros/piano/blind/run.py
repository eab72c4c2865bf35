"""Diagnosis of blind cases in parallel. Nothing here can open the answers: it is not told where
they are.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.piano.blind.folder import RESULTS, read_manifest

__all__ = ["diagnose_cases", "diagnose_one"]


def diagnose_cases(
    folder: str | Path,
    *,
    jobs: int = 1,
    backend: str = "loky",
    budget: int = DIAGNOSIS_BUDGET,
    seed: int = 0,
    again: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Diagnose every case of ``folder`` into ``folder/results/<case>.json``; returns that folder.

    ``jobs`` processes by joblib's ``backend`` (loky, dask, ray, threading). Cases with a result are
    skipped unless ``again``.
    """
    from joblib import Parallel, delayed, parallel_config

    folder = Path(folder)
    manifest = read_manifest(folder)
    names, without = manifest["cases"], manifest.get("without", {})
    results = folder / RESULTS
    results.mkdir(exist_ok=True)
    todo = [n for n in names if again or not (results / f"{n}.json").is_file()]
    work = (
        delayed(diagnose_one)(
            str(folder / n), str(results / f"{n}.json"), seed, budget, without.get(n, "")
        )
        for n in todo
    )
    with parallel_config(
        backend=backend, n_jobs=jobs
    ):  # unlike Parallel(backend=…), this knows Dask
        parallel = Parallel(return_as="generator_unordered" if backend == "loky" else "list")
        for i, name in enumerate(parallel(work)):
            if progress:
                progress(f"diagnosed {name}", (i + 1) / len(todo))
    return results


def diagnose_one(bag: str, result: str, seed: int, budget: int, without: str = "") -> str:
    """Diagnose one bag, by a library that lacks the family ``without``, and write diagnosis.json's
    content with what AIC and BIC would have said; returns the case's name.
    """
    from pianobot_ros.gap import GapError, diagnose
    from pianobot_ros.piano.gap.diagnosis.settings import options
    from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

    name = Path(bag).name
    try:
        twin = PianoTwin([read_bag(bag)], without=(without,) if without else ())
        found = diagnose(twin, twin.blocks, seed=seed, budget=budget, options=options())
        document = found.to_json()
        document["criteria"] = criteria(twin, found)
    except (PianobotError, GapError) as error:
        document = {"verdict": "error", "sentence": str(error)}
    write_whole(result, json.dumps(document, indent=1) + "\n")
    return name


def criteria(twin: Any, found: Any) -> dict[str, str]:
    """Which hypothesis AIC and BIC choose, on the same fits, from independent Gaussian residuals as
    most people would.

    Every observable has its own variance, at its maximum likelihood.
    """
    scores: dict[str, dict[str, float]] = {"aic": {}, "bic": {}}
    for hypothesis in found.hypotheses:
        if hypothesis.name != "none" and not hypothesis.values:
            continue
        nominal = {p.name: p.nominal for p in twin.parameters}
        predictions = twin.simulate(
            twin.blocks, {**nominal, **hypothesis.values}, hypothesis.effects
        )
        cost, count = 0.0, 0
        for observable in twin.observables:
            residual = _residual(twin.blocks, predictions, observable)
            if residual.size:
                cost += residual.size * float(np.log(np.mean(residual**2) + 1e-300))
                count += residual.size
        k = len(hypothesis.values) if hypothesis.name != "none" else 0
        scores["aic"][hypothesis.name] = cost + 2 * k
        scores["bic"][hypothesis.name] = cost + k * float(np.log(max(count, 1)))
    return {name: min(table, key=lambda h: table[h]) for name, table in scores.items() if table}


def _residual(blocks: Any, predictions: Any, observable: Any) -> np.ndarray:
    parts = []
    for block, prediction in zip(blocks, predictions, strict=True):
        if observable.name not in prediction:
            continue
        if observable.kind == "event":
            real = np.array([block.events.get(observable.signal, np.nan)])
        elif observable.signal in block.outputs:
            real = block.outputs[observable.signal].y
        else:
            continue
        difference = real - np.asarray(prediction[observable.name], dtype=float)
        parts.append(difference[np.isfinite(difference)])
    return np.concatenate(parts) if parts else np.zeros(0)
