"""The blind check from end to end: makes cases, diagnoses them, scores them and writes the table.

python benchmarks/blind.py --cases 120 --seed 20260309 --jobs 2 --out docs/results/blind.md
python benchmarks/blind.py --cases 60 --seed 20260305 --laws 2 --jobs 2

The second draws by laws of the plant that `benchmarks/calibrate.py --laws 0,1` has not seen.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.piano.blind import Design, diagnose_cases, make_cases, score_cases


def main() -> int:
    options = _options()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        cases, answers = folder / "cases", folder / "answers.json"
        begun = time.perf_counter()
        if not (cases / "manifest.json").is_file():
            design = Design(
                cases=options.cases,
                seed=options.seed,
                strikes=options.strikes,
                rig=not options.no_rig,
                laws=[int(law) for law in options.laws.split(",")],
            )
            make_cases(cases, answers, design, jobs=options.jobs, progress=_say)
        made = time.perf_counter()
        _diagnose(cases, options)
        done = time.perf_counter()
        score = score_cases(cases, answers)
    command = "python benchmarks/blind.py " + " ".join(sys.argv[1:])
    text = (
        f"# Blind check\n\n`{command}`: {options.cases} cases of {options.strikes} strikes, seed"
        f" {options.seed}; made in {made - begun:.0f} s, diagnosed in {done - made:.0f} s.\n\n"
        + score.to_text()
        + "\nWrong:\n\n"
        + "\n".join(f"- {w}" for w in score.wrong)
        + "\n"
    )
    print(text)
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text, encoding="utf-8")
        options.out.with_suffix(".json").write_text(
            json.dumps(score.to_json(), indent=1) + "\n", encoding="utf-8"
        )
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=120)
    parser.add_argument("--seed", type=int, default=20260309)
    parser.add_argument("--strikes", type=int, default=40)
    parser.add_argument("--laws", default="0,1,2", help="laws of the plant that effects act by")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--backend", choices=("loky", "dask", "threading"), default="loky")
    parser.add_argument("--workers", type=int, default=2, help="local Dask workers")
    parser.add_argument(
        "--budget", type=int, default=DIAGNOSIS_BUDGET, help="simulated strikes for each case"
    )
    parser.add_argument(
        "--no-rig", action="store_true", help="a cell without the key's angle sensor"
    )
    parser.add_argument("--keep", type=Path, help="keep cases and answers in this folder")
    parser.add_argument("--out", type=Path, help="write the table here (and beside it as JSON)")
    return parser.parse_args()


def _diagnose(cases: Path, options: argparse.Namespace) -> None:
    if options.backend == "dask":
        from dask.distributed import Client, LocalCluster

        with (
            LocalCluster(n_workers=options.workers, threads_per_worker=1) as cluster,
            Client(cluster),
        ):
            diagnose_cases(cases, jobs=-1, backend="dask", budget=options.budget, progress=_say)
    else:
        how = {"jobs": options.jobs, "backend": options.backend, "budget": options.budget}
        diagnose_cases(cases, **how, progress=_say)


def _say(text: str, share: float) -> None:
    print(f"{100 * share:3.0f} % {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
