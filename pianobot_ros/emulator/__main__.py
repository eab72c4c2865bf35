"""``python -m pianobot_ros.emulator``: the whole emulated cell.

Prints the addresses of its devices as one JSON object on one line (which is YAML too) once all are
ready, then runs until SIGINT or SIGTERM.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.priority import request_high
from pianobot_ros.emulator.cell import DEVICES, CellOptions, EmulatedCell
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.cases.draw import KINDS, draw_case
from pianobot_ros.emulator.plant.cases.effects import parse_effects
from pianobot_ros.emulator.plant.live_plant import write_secret
from pianobot_ros.emulator.serving.bus import default_path

__all__ = ["main"]


def _directory(name: str, default: CellOptions) -> Path:
    """The cell of the default name is where ``config/`` looks for it."""
    return (
        default.directory
        if name == "cell"
        else default.directory.with_name(f"{default.directory.name}-{name}")
    )


def _parser(default: CellOptions) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m pianobot_ros.emulator", description=(__doc__ or "").split("\n\n")[0]
    )
    parser.add_argument(
        "--name",
        default="cell",
        help="several cells at once need several names (default %(default)s)",
    )
    parser.add_argument(
        "--host", default=default.host, help="loopback address of the arm (default %(default)s)"
    )
    parser.add_argument(
        "--model",
        choices=["cb3", "e-series"],
        default=default.model,
        help="arm (default %(default)s)",
    )
    parser.add_argument(
        "--midi-transport",
        choices=["auto", "alsa", "jack", "socket"],
        help="default: as midi.yaml says",
    )
    parser.add_argument(
        "--midi-name", help="name of the piano's ports on ALSA or JACK (default: as midi.yaml says)"
    )
    parser.add_argument(
        "--midi-socket",
        metavar="HOST:PORT",
        help="where the piano listens (default: as midi.yaml says)",
    )
    parser.add_argument(
        "--directory", type=Path, help="for links to pseudo-terminals and for control sockets"
    )
    parser.add_argument(
        "--devices", default=",".join(DEVICES), help="which to start (default %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed (default %(default)s)")
    parser.add_argument(
        "--effects", default="", help="name=magnitude,... in units of the repeatability floor"
    )
    parser.add_argument(
        "--draw",
        choices=KINDS,
        help="draw a cell of this kind by the seed instead, and keep it secret",
    )
    parser.add_argument(
        "--magnitude",
        type=float,
        nargs=2,
        default=(1.0, 10.0),
        metavar=("LOW", "HIGH"),
        help="bounds of what --draw draws, in units of the repeatability floor (default 1 10)",
    )
    parser.add_argument(
        "--secret", type=Path, help="write what this cell is to FILE, readable by its owner only"
    )
    return parser


def _case(options: argparse.Namespace) -> Case:
    """The cell that is asked for. Raises PianobotError."""
    if options.draw:
        return draw_case(options.seed, options.draw, magnitude=tuple(options.magnitude))
    return Case(parse_effects(options.effects), seed=options.seed)


def _cell_options(options: argparse.Namespace, default: CellOptions) -> CellOptions:
    """Where the cell is to be, and with which devices. Raises PianobotError."""
    devices = tuple(name for name in options.devices.split(",") if name)
    if unknown := [name for name in devices if name not in DEVICES]:
        raise PianobotError(f"unknown device(s) {', '.join(unknown)}; valid: {', '.join(DEVICES)}")
    midi = {
        "transport": options.midi_transport,
        "name": options.midi_name,
        "socket": options.midi_socket,
    }
    return replace(
        default,
        host=options.host,
        model=options.model,
        devices=devices,
        midi={name: value for name, value in midi.items() if value},
        bus=default_path(options.name),
        directory=options.directory or _directory(options.name, default),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until told to stop; 2 on bad input, 1 if a device ended by itself."""
    default = CellOptions()
    options = _parser(default).parse_args(arguments)
    request_high()  # and with it every device that is started from here
    try:
        case, chosen = _case(options), _cell_options(options, default)
        if options.secret:
            write_secret(options.secret, case)
    except PianobotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _: stopping.append(got))
    cell = EmulatedCell(case, chosen)
    try:
        cell.start()
        print(json.dumps(cell.addresses()), flush=True)
        while not stopping:
            cell.attend(0.2)
    except PianobotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    finally:
        cell.stop()
        with contextlib.suppress(OSError):  # not empty: somebody else's, too
            chosen.directory.rmdir()
        # Python puts back the default while it ends, and a second Ctrl-C would make an orderly end
        # look like a crash.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    return 0


if __name__ == "__main__":
    sys.exit(main())
