"""A headless browser for pages, on machines without a graphics card too."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from typing import Any

__all__ = ["chromium", "find_chromium"]

NAMES = ("chromium", "chromium-browser", "google-chrome")
START = 120e3  # ms that it may take on a busy machine
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
