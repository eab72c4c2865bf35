"""Buttons on the page. What they do is given; what it says is shown."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

from pianobot_ros.piano.view.html_tables import STYLE

__all__ = ["ControlPanel"]


class ControlPanel:
    """A panel with a choice of phrases and a button for each action.

    ``actions`` by label: each is called on a thread of its own with the phrase chosen and a
    function that shows one line, and returns its last line. What runs is not started again.
    """

    def __init__(
        self,
        gui: Any,
        phrases: Sequence[str],
        actions: Mapping[str, Callable[[str, Callable[[str], None]], str]],
    ) -> None:
        self._busy: set[str] = set()
        self._lock = threading.Lock()
        panel = gui.add_panel()
        with panel.add_tab("Controls"):
            self._phrase = gui.add_dropdown("phrase", tuple(phrases))
            buttons = gui.add_button_group("do", tuple(actions))
            self._said = gui.add_html("")
        panel.float(x=12, y=12)  # of what the panels at both sides leave
        panel.set_width(420)
        panel.expand()  # on a telephone, too, where it is a section of the sheet
        self._actions = dict(actions)
        buttons.on_click(lambda event: self.press(event.target.value))
        self.tell("ready")

    def tell(self, line: str) -> None:
        """Show one line."""
        self._said.content = f'{STYLE}<div class="pb" data-part="said">{escape(line)}</div>'

    def press(self, label: str) -> None:
        """Do what a button says, unless it is being done."""
        with self._lock:
            if label in self._busy:
                self.tell(f"{label}: under way already")
                return
            self._busy.add(label)
        threading.Thread(target=self._do, args=(label,), name=label, daemon=True).start()

    def _do(self, label: str) -> None:
        try:
            if self._phrase.value not in self._phrase.options:  # no browser offers that
                raise ValueError("no such phrase")
            self.tell(f"{label} …")
            self.tell(f"{label}: {self._actions[label](self._phrase.value, self.tell)}")
        except Exception as error:  # shown to who pressed the button; the page goes on
            self.tell(f"{label} failed: {type(error).__name__}: {error}")
        finally:
            with self._lock:
                self._busy.discard(label)
