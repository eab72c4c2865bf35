"""Make the README's pictures from the page itself: ``docs/pictures/window.png`` and
``docs/pictures/strike.webp`` (a strike, slowed down).

    python tools/pictures.py [BAG]

Without a bag, the emulated cell plays the phrase of the demo with one hidden effect, the twin
answers, and the recording is diagnosed.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pianobot_ros.bags.write import write_bag
from pianobot_ros.piano.view.page import Page
from pianobot_ros.piano.view.replay import Replay
from pianobot_ros.piano.view.tape.from_bag import load_tape, with_twin
from pianobot_ros.piano.view.tape.stage_history import fill_stages
from pianobot_ros.testing.browser import chromium, open_page

FOLDER = Path("docs/pictures")
PHRASE, SEED = "demo", 1
EFFECT = {"wrist_delay": 8.0}  # units of the repeatability floor
BUDGET = 12_000  # strikes simulated for the diagnosis: enough for one clear effect
NOON = 1.7e9  # s since the epoch, of a recording that nobody made
MAGNIFIED = 5
PATIENCE = 180.0  # s, on a busy machine without a graphics card
FRAMES, BEFORE, AFTER = 14, 0.07, 0.24  # of the animation; s around the onset
FRAME, CLOSE = (260, 420), 0.40  # height and width of a frame, pixels; angle of view, rad
WHOLE, SMALL = {"width": 1360, "height": 900}, {"width": 830, "height": 200}
SETTLED = 3000  # ms in which the charts are drawn


def emulated(folder: Path) -> Path:
    """A bag of what ``pianobot demo`` plays, on the emulated cell with :data:`EFFECT`, with the
    twin's answer; its diagnosis lies beside it.
    """
    from pianobot_ros.cell.score import load_score, plan_score
    from pianobot_ros.emulator.plant.offline import simulate_cell
    from pianobot_ros.piano.gap import diagnose_bag

    found = simulate_cell(plan_score(load_score(PHRASE)), effects=EFFECT, seed=SEED)
    bag = write_bag(with_twin(replace(found, epoch=NOON)), folder / "bag")
    diagnose_bag(bag, output=folder / "diagnosis", budget=BUDGET)
    return bag


def opened(browser: Any, page: Page) -> Any:
    """The page, drawn."""
    view = open_page(browser, page.address, "timeline", SMALL)
    # That there is no graphics card is no news here.
    view.add_style_tag(content=".mantine-Notifications-root { display: none }")
    return view


def go(view: Any, replay: Replay, position: float) -> None:
    """Seek, and wait until the browser shows it."""
    replay.player.seek(position)
    shown = f"{position - replay.player.start:.3f}"
    view.wait_for_function(
        f"document.querySelector('[data-part=timeline]').dataset.at == '{shown}'",
        timeout=1e3 * PATIENCE,
    )


def animate(view: Any, page: Page, replay: Replay, onset: float) -> list[Image.Image]:
    """Frames of a strike as the browser renders them, with the time and the force above."""
    client = next(iter(page.server.get_clients().values()))
    usual, client.camera.fov = client.camera.fov, CLOSE
    font = ImageFont.load_default(15)
    frames = []
    for at in np.linspace(onset - BEFORE, onset + AFTER, FRAMES):
        go(view, replay, float(at))
        picture = Image.fromarray(np.asarray(client.get_render(*FRAME, timeout=PATIENCE)))
        draw = ImageDraw.Draw(picture)
        force = page.tape.latest("real/fsr.force", float(at))
        words = f"{1e3 * (at - onset):+5.0f} ms   {force[1] if force else 0.0:4.1f} N"
        draw.text((10, 8), f"{words}   ghost x {MAGNIFIED}", fill=(40, 44, 50), font=font)
        frames.append(picture)
    client.camera.fov = usual
    return frames


def still(view: Any, replay: Replay, at: float, path: Path) -> None:
    """The whole page at a moment, in few colours."""
    view.set_viewport_size(WHOLE)
    go(view, replay, at)
    view.wait_for_timeout(SETTLED)
    view.screenshot(path=path, timeout=1e3 * PATIENCE)
    picture = Image.open(path).convert("RGB")
    picture.quantize(192, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)


def main() -> None:
    """Write both pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag", type=Path, nargs="?", help="recording to show")
    given = parser.parse_args().bag
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        bag = given or emulated(Path(folder))
        tape, (start, end), recording = load_tape(bag)
        if len(tape.stages) < 2:
            fill_stages(recording, tape)
        page = Page(tape, port=0)
        replay = Replay(page, start, end)
        page.magnify.value = MAGNIFIED
        view = opened(browser, page)
        shown = replay.worst() or tape.rows[0]
        onset = shown.sim.onset if shown.sim else shown.start
        frames = animate(view, page, replay, onset)
        last = tape.rows[-1]
        still(view, replay, last.sim.onset if last.sim else last.start, FOLDER / "window.png")
        replay.close()
        page.close()
    frames[0].save(
        FOLDER / "strike.webp",
        save_all=True,
        append_images=frames[1:],
        duration=120,
        loop=0,
        quality=72,
        method=6,
    )
    print(f"wrote {FOLDER}/window.png and {FOLDER}/strike.webp")


if __name__ == "__main__":
    main()
