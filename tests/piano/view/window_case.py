"""A browser's view of a page, and what tests ask of it."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from PIL import Image

from pianobot_ros.piano.view.page import Page
from pianobot_ros.testing.browser import seldom

REST = 1.0  # s between two drawings
POLL = 0.2  # s between two looks at what is waited for
TELEPHONE = (400, 300)  # each pixel costs its share of a drawing
PATIENCE = 250.0  # s, on a busy machine without a graphics card


@dataclass
class Window:
    """The served page and a browser's ``view`` of it; ``errors`` are those of its console."""

    page: Page
    view: Any
    errors: list[str] = field(default_factory=list)

    def ask(self, script: str) -> Any:
        return self.view.evaluate(script)

    def wait(self, script: str) -> None:
        self.view.wait_for_function(script, timeout=1e3 * PATIENCE, polling=1e3 * POLL)

    def resize(self, size: tuple[int, int]) -> None:
        self.view.set_viewport_size({"width": size[0], "height": size[1]})

    def text(self, part: str) -> str:
        return str(self.view.inner_text(f"[data-part={part}]", timeout=1e3 * PATIENCE))

    def press(self, name: str) -> None:
        button = self.view.get_by_role("button", name=name, exact=True)
        button.click(timeout=1e3 * PATIENCE)

    def chart(self, title: str, holds: str) -> str:
        """A script that is true when ``holds``, said of a uPlot ``u``, is so of that chart."""
        return (
            "Object.values(window.__viserTestpoints.uplots).map(made => made.chart).some("
            f"u => u.root.innerText.includes('{title}') && ({holds}))"
        )

    def drawn(self, title: str, colour: str) -> str:
        """A script that is true when the first curve of a chart has that colour, seen or not."""
        return self.chart(title, f"u.series[1].stroke(u, 1) == '{colour}'")

    def picture(self, height: int = 180, width: int = 300) -> np.ndarray:
        """What the browser renders of the scene, (height, width, 3)."""
        client = next(iter(self.page.server.get_clients().values()))
        return np.asarray(client.get_render(height, width, timeout=PATIENCE)).astype(int)

    def canvas(self) -> np.ndarray:
        """What is seen where the scene is drawn, (height, width, 3)."""
        shot = self.view.locator("canvas").first.screenshot(timeout=1e3 * PATIENCE)
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)


def look(browser: Any, page: Page, part: str, script: str = "") -> Window:
    """Open ``page`` in ``browser``, where ``script`` runs before it, and wait until one of its
    parts is there.
    """
    view = browser.new_page(viewport={"width": TELEPHONE[0], "height": TELEPHONE[1]})
    view.add_init_script(script + seldom(REST))
    found = Window(page, view)
    view.on("pageerror", lambda error: found.errors.append(str(error)))
    view.on(
        "console", lambda said: found.errors.append(said.text) if said.type == "error" else None
    )
    view.goto(page.address, timeout=1e3 * PATIENCE)
    view.wait_for_selector(f"[data-part={part}]", timeout=1e3 * PATIENCE)
    # That there is no graphics card is said over the buttons.
    view.add_style_tag(
        content=".mantine-Notifications-root, .mantine-Notifications-root * "
        "{ pointer-events: none !important }"
    )
    return found
