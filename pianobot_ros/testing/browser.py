"""A headless browser for pages, on machines without a graphics card too."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from typing import Any

__all__ = ["chromium", "find_chromium", "open_page", "seldom", "undrawn"]

NAMES = ("chromium", "chromium-browser", "google-chrome")
START = 300e3  # ms that it may take on a busy machine, where it has never been started
LOADED = 300e3  # ms that a page may take there, without a graphics card
WORDS = ("--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--no-sandbox")


def find_chromium() -> str | None:
    """Path of a Chromium that the system has, or None."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """A browser of Playwright's (its synchronous interface). Raises RuntimeError where there is
    none.
    """
    path = find_chromium()
    if path is None:
        raise RuntimeError("no Chromium here: install the Debian package chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(WORDS), timeout=START)
        try:
            yield browser
        finally:
            browser.close()


def open_page(browser: Any, address: str, part: str, size: dict[str, int], script: str = "") -> Any:
    """A page of ``browser``, ``size`` (width, height) pixels, that shows ``address``; ``script``
    runs before it. Returns once its part ``part`` is there.
    """
    view = browser.new_page(viewport=size)
    if script:
        view.add_init_script(script)
    view.goto(address, timeout=LOADED)
    view.wait_for_selector(f"[data-part={part}]", timeout=LOADED)
    return view


def seldom(pause: float) -> str:
    """A script for a page that lets it rest for ``pause`` s between two drawings. Without a
    graphics card one takes a second of a core, and the next would begin at once.
    """
    return f"""
{{
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = draw => setTimeout(() => next(draw), {1e3 * pause:.0f});
  window.cancelAnimationFrame = clearTimeout.bind(window);
}}
"""


def undrawn() -> str:
    """A script for a page that leaves its scene empty, where what it says is looked at. Without
    a graphics card drawing the scene takes most of a core.
    """
    return """
for (const name of Object.getOwnPropertyNames(WebGL2RenderingContext.prototype))
  if (/^(draw(Arrays|Elements|Range)|clear$|blit)/.test(name))
    WebGL2RenderingContext.prototype[name] = () => {};
"""
