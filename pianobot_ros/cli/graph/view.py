"""``pianobot view``: the window in the browser, on a bag or on a running graph."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from pianobot_ros.cli.shared_options import Controls, Host
from pianobot_ros.piano.view.address import DEFAULT_HOST, DEFAULT_PORT, warn_if_open

BEFORE = 1.0  # s before the first strike where a replay begins

__all__ = ["before_a_screen", "open_in_browser", "register", "view"]


def before_a_screen() -> bool:
    """Whether somebody sits before a screen of this machine."""
    seen = (
        sys.platform in ("darwin", "win32")
        or os.environ.get("DISPLAY")
        or os.environ.get("WAYLAND_DISPLAY")
    )
    return bool(seen) and sys.stdout.isatty()


def open_in_browser(address: str) -> None:
    """Show a page where somebody sits before a screen."""
    if before_a_screen():
        webbrowser.open(address)


def view(
    bag: Annotated[
        Path | None, typer.Argument(help="Bag directory or .mcap file; none: the running graph.")
    ] = None,
    host: Host = DEFAULT_HOST,
    port: Annotated[
        int, typer.Option(help="Port; the next free one if it is taken, 0: any.")
    ] = DEFAULT_PORT,
    browser: Annotated[bool, typer.Option(help="Open it where there is a screen.")] = True,
    controls: Controls = False,
) -> None:
    """Show the real cell beside its ghost in the browser, until Ctrl-C."""
    if bag is None:
        from pianobot_ros.nodes.graph import ros_arguments
        from pianobot_ros.nodes.watching.viewer import main

        parameters = {"host": host, "port": port, "controls": controls}
        raise typer.Exit(main(ros_arguments(parameters)))
    from pianobot_ros.piano.view.page import Page
    from pianobot_ros.piano.view.replay import Replay
    from pianobot_ros.piano.view.tape.from_bag import load_tape
    from pianobot_ros.piano.view.tape.stage_history import fill_stages

    tape, span, recording = load_tape(bag)
    warn_if_open(host)
    page = Page(tape, host=host, port=port)
    replay = Replay(page, *span)
    if tape.strikes:  # nobody cares to see how the nodes started
        replay.player.seek(tape.strikes[0].start - BEFORE)
    typer.echo(f"{page.address}  (Ctrl-C ends it)")
    if browser:
        open_in_browser(page.address)
    closing = threading.Event()

    def more() -> bool:
        replay.redraw()
        return not closing.is_set()

    if len(tape.stages) < 2:  # nobody said them while the bag was recorded
        threading.Thread(target=fill_stages, args=(recording, tape, more), daemon=True).start()
    try:
        closing.wait()
    except KeyboardInterrupt:
        closing.set()
    finally:
        replay.close()
        page.close()


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("view")(view)
