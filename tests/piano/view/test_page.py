"""The page in a real browser: a recorded cell whose real side comes late, played again."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
import viser
from view_cases import NOTE, recording
from websockets.sync.client import connect
from window_case import PATIENCE, TELEPHONE, Window, look

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.piano.twin.model.keyboard import key_geom
from pianobot_ros.piano.view.address import is_loopback, warn_if_open
from pianobot_ros.piano.view.html_tables import QUIET, REAL, clock
from pianobot_ros.piano.view.page import Page
from pianobot_ros.piano.view.replay import Replay
from pianobot_ros.piano.view.scene.cell_view import FORCE, LIGHT, SILENT
from pianobot_ros.piano.view.tape.from_bag import tape_of
from pianobot_ros.testing import wait_for

pytestmark = pytest.mark.slow


@dataclass
class Replayed(Window):
    """A window on a recording that is played again."""

    replay: Replay = field(kw_only=True)

    def seek(self, position: float) -> None:
        self.replay.player.playing = False
        self.replay.redraw()
        self.replay.player.seek(position)  # last: so it is drawn once
        # What the browser shows of the moment comes to it after the scene, in the same stream.
        at = f"{position - self.replay.player.start:.3f}"
        self.wait(f"document.querySelector('[data-part=timeline]').dataset.at == '{at}'")


@pytest.fixture(scope="module")
def window(browser: Any) -> Iterator[Replayed]:
    tape = tape_of(recording(4, late=0.04, silent=(2.0, 3.2)))
    page = Page(tape, port=0)
    replay = Replay(page, 0.0, 6.4)
    seen = look(browser, page, "timeline")
    yield Replayed(page, seen.view, seen.errors, replay=replay)
    seen.view.close()
    replay.close()
    page.close()


@pytest.mark.parametrize(
    ("host", "origin", "comes_in"),
    [
        ("{}", "http://{}", True),
        ("{}", None, True),
        ("{}", "http://evil.example", False),
        ("evil.example", "http://evil.example", False),
    ],
)
def test_pages_of_other_sites_stay_out(
    window: Replayed, host: str, origin: str | None, comes_in: bool
) -> None:
    place = window.page.address.removeprefix("http://")
    said = {"Host": host.format(place)}
    if origin is not None:
        said["Origin"] = origin.format(place)
    lines = [f"{name}: {value}" for name, value in said.items()]
    wanted = ["GET / HTTP/1.1", *lines, "Upgrade: websocket", "Connection: Upgrade"]
    wanted += ["Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version: 13"]
    wanted += [f"Sec-WebSocket-Protocol: viser-v{viser.__version__}", "", ""]
    address, port = place.split(":")
    with socket.create_connection((address, int(port)), PATIENCE) as link:
        link.sendall("\r\n".join(wanted).encode())
        status = link.makefile("rb").readline().split()[1]
    assert status == (b"101" if comes_in else b"403")


def test_panels_lie_beside_each_other_and_all_are_on_a_telephone(window: Replayed) -> None:
    edge = "document.querySelector('[data-part={}]').getBoundingClientRect().{}"
    # Loaded as a telephone shows it: the fixture waits until the timeline is seen.
    assert window.ask("innerWidth") == TELEPHONE[0]
    assert 0 < window.ask(edge.format("timeline", "right")) <= TELEPHONE[0]
    window.resize((1280, 200))
    try:
        window.wait(f"{edge.format('legend', 'right')} > 0")
        window.wait(f"{edge.format('legend', 'right')} <= {edge.format('timeline', 'left')}")
        window.wait(f"{edge.format('timeline', 'right')} <= {edge.format('strikes', 'left')}")
    finally:
        window.resize(TELEPHONE)


RECONNECTS = 10


def blue(picture: np.ndarray) -> int:
    """Pixels in the ghost's colour."""
    red, green, blue_ = np.moveaxis(picture, -1, 0)
    return int(np.sum((blue_ > red + 45) & (blue_ > green + 12)))


def red(picture: np.ndarray) -> int:
    """Pixels in the colour of a measured force."""
    red_, green, blue_ = np.moveaxis(picture, -1, 0)
    return int(np.sum((red_ > green + 70) & (red_ > blue_ + 70) & (green < 110)))


def test_page_loads_without_errors_and_draws(window: Replayed) -> None:
    assert window.ask("document.querySelectorAll('canvas').length") >= 1
    assert "estimated" in window.text("estimated")
    assert window.picture().std() > 10
    assert not window.errors


def test_canvas_changes_while_a_phrase_plays(window: Replayed) -> None:
    window.seek(0.3)
    before = window.canvas()
    assert before.std() > 10
    player = window.replay.player
    player.speed = 0.1  # a slow browser must not see its end only
    try:
        window.view.get_by_role("button", name="play/pause").click(timeout=1e3 * PATIENCE)
        wait_for(lambda: player.position > 0.4, "the recording plays", PATIENCE)
        wait_for(lambda: np.abs(window.canvas() - before).mean() > 0.3, "it is seen", PATIENCE)
    finally:
        player.playing, player.speed = False, 1.0


@pytest.mark.long
def test_ghost_leaves_the_solid_where_the_cells_differ_and_not_where_they_agree(
    window: Replayed,
) -> None:
    row, differing = window.replay.tape.rows[0], window.page.tape
    moment = row.sim.onset - 0.005  # the twin is ahead
    window.page.magnify.value = 8
    try:
        window.page.tape = tape_of(recording(4))  # no effect: both cells are one
        window.seek(moment)
        one = window.picture()
        window.seek(0.2)
        window.page.tape = differing
        window.seek(moment)
        wait_for(lambda: blue(window.picture()) > 3 * blue(one) + 40, "a ghost", PATIENCE)
    finally:
        window.page.tape = differing
        window.page.magnify.value = 1


@pytest.mark.long
def test_force_is_an_arrow_and_a_sounding_key_lights_up(window: Replayed) -> None:
    row = window.replay.tape.rows[0]
    real = window.page._cells["real"]
    window.seek(0.2)  # nothing is touched
    assert not real._arrow.visible and not real._lit
    window.seek(row.real.onset + 0.1)
    assert real._arrow.visible and tuple(real._arrow_colour) == FORCE
    real._arrow.visible = False
    bare = red(window.picture(360, 600))
    real._arrow.visible = True
    wait_for(lambda: red(window.picture(360, 600)) > bare + 8, "an arrow", PATIENCE)
    (key,) = real._keys[NOTE]
    assert real._lit == {NOTE} and tuple(key[0].color) == LIGHT


def test_key_stands_at_its_measured_angle(window: Replayed) -> None:
    row, page = window.replay.tape.rows[0], window.page
    for at in (0.2, row.real.onset + 0.1):
        window.seek(at)
        _, angle = page.tape.latest(f"real/key_angle.{NOTE}", at)
        body = page._solvers["real"].model.body(key_geom(NOTE)).id
        frame = page._cells["real"]._frames[body - 1]
        assert 2 * np.arcsin(np.linalg.norm(frame.wxyz[1:])) == pytest.approx(angle, abs=1e-3)
    assert angle > 0.03


def test_cell_that_has_gone_silent_is_grey_and_says_since_when(window: Replayed) -> None:
    whole = window.page.tape
    try:
        window.page.tape = tape_of(recording(1))  # says nothing after 1.9 s
        window.seek(4.0)
        for view in window.page._cells.values():
            assert {tuple(h.color) for h, part in view._meshes if part.body} == {SILENT}
        window.wait("document.querySelector('[data-part=streams]').innerText.includes('since')")
        said = window.text("streams")
        assert said.count("silent since") == 8
        assert clock(whole.epoch + 1.9) in said
    finally:
        window.page.tape = whole
    window.seek(1.9)
    assert all(not view._silent for view in window.page._cells.values())


def test_each_strike_adds_a_row_and_a_point(window: Replayed) -> None:
    for count in (1, 3, 4):
        window.seek(window.replay.tape.rows[count - 1].time + 1e-3)
        window.wait(f"document.querySelectorAll('[data-strike]').length == {count}")
        window.wait(window.chart("Err of Eq. 5", f"u.data[1].length == {count}"))


def test_silent_stream_turns_grey_and_back(window: Replayed) -> None:
    state = "document.querySelector('[data-stream=\"real/fsr\"]').dataset.state"
    for at, wanted in ((1.9, "live"), (2.9, "silent"), (3.6, "live")):
        window.seek(at)
        window.wait(f"{state} == '{wanted}'")
        window.wait(window.drawn("force", QUIET if wanted == "silent" else REAL))


def test_jump_to_the_worst_strike_shows_its_numbers(window: Replayed) -> None:
    worst = window.replay.worst()
    window.seek(0.2)
    window.view.get_by_role("button", name="worst").click(timeout=1e3 * PATIENCE)
    window.wait(
        "document.querySelector('[data-strike]') &&"
        f" document.querySelector('[data-strike]').dataset.strike == '{worst.index}'"
    )
    assert f"{100 * worst.err:.1f} %" in window.text("strikes")


@pytest.mark.long
def test_a_second_browser_sees_the_same_and_reconnects_leak_nothing(window: Replayed) -> None:
    page, before = window.page, threading.active_count()
    connected = page.server._websock_server._client_state_from_id
    address = page.address.replace("http", "ws")
    protocol: Any = f"viser-v{viser.__version__}"
    for _ in range(RECONNECTS):
        with connect(address, subprotocols=[protocol], max_size=None) as client:
            received = 0
            while received <= 1000:
                received += len(client.recv(timeout=PATIENCE))
            wait_for(lambda: len(connected) == 2, "two browsers", timeout=PATIENCE)
        wait_for(lambda: len(connected) == 1, "one browser again", timeout=PATIENCE)
    # The server's pool may have grown by some; a leak would be one for each.
    wait_for(lambda: threading.active_count() < before + RECONNECTS, "threads ended", PATIENCE)
    wait_for(lambda: page.clients == 1, "one that looks", PATIENCE)
    # One that hangs: it takes nothing of what it is sent, and the other is served on.
    with connect(address, subprotocols=[protocol], max_size=None, max_queue=1):
        wait_for(lambda: len(connected) == 2, "two browsers", timeout=PATIENCE)
        for count in (4, 1, 3):
            for at in np.linspace(0.0, 1.0, 20):
                page.update(float(at))
            window.seek(window.replay.tape.rows[count - 1].time + 1e-3)
            window.wait(f"document.querySelectorAll('[data-strike]').length == {count}")
    assert not window.errors


def test_address_is_checked_and_an_open_one_is_warned_of(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tape = tape_of(recording(1))
    with pytest.raises(PianobotError, match="address"):
        Page(tape, host="192.0.2.1")
    with pytest.raises(PianobotError, match="port"):
        Page(tape, port=70000)
    assert is_loopback("127.0.0.1")
    warn_if_open("127.0.0.1")
    assert not capsys.readouterr().err
    warn_if_open("0.0.0.0")
    assert "no password" in capsys.readouterr().err
