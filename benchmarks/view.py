"""What the page in the browser costs: cores that the node ``viewer`` takes while the emulated cell
plays, without a browser and with one.

    python benchmarks/view.py [--seconds 20] [--out FILE]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import psutil

from pianobot_ros.cli.graph.running_cell import SupervisedCell, isolated_emulation, running_cell
from pianobot_ros.testing.browser import chromium, open_page

PHRASE = "demo"


def share(cell: SupervisedCell, seconds: float) -> float:
    """Cores that ``viewer`` takes over ``seconds`` s."""
    process = psutil.Process(cell.supervisor.pids["viewer"])
    before, begun = sum(process.cpu_times()[:2]), time.monotonic()
    while time.monotonic() < begun + seconds:
        cell.turn()
    return float(sum(process.cpu_times()[:2]) - before) / (time.monotonic() - begun)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--out", type=Path, help="also write a page of docs/results")
    options = parser.parse_args()
    seconds, load = options.seconds, os.getloadavg()[0]
    taken = os.environ.get("ROS_DOMAIN_ID")
    domain = int(taken) if taken else 1 + int.from_bytes(os.urandom(2), "little") % 100
    with (
        tempfile.TemporaryDirectory() as folder,
        running_cell(
            emulated=isolated_emulation(),
            jobs=False,
            screen=False,
            run=Path(folder) / "run",
            domain=domain,
            view=True,
        ) as cell,
    ):
        cell.wait(lambda: cell.address, 60.0, lambda: "the page did not come up")
        from pianobot_msgs.action import PlayPhrase

        cell.observer.send(PlayPhrase.Goal(score=PHRASE))
        idle = share(cell, seconds)
        with chromium() as browser:
            open_page(browser, cell.address, "streams", {"width": 640, "height": 400})
            share(cell, 3.0)
            seen = share(cell, seconds)
    table = [
        "| viewer, the cell plays | asked | cores |",
        "|---|---|---|",
        f"| no browser | ≤ 0.03 | {idle:.3f} |",
        f"| one browser, 20 Hz | ≤ 0.25 | {seen:.3f} |",
    ]
    print(*table, sep="\n")
    if options.out:
        head = [
            "# What the page in the browser costs",
            "",
            f"Written by `python benchmarks/view.py --seconds {seconds:g} --out"
            f" docs/results/view.md`: cores of the node `viewer` on {os.cpu_count()} cores,"
            f" load of the machine {load:.1f}.",
            "",
        ]
        options.out.write_text("\n".join([*head, *table]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
