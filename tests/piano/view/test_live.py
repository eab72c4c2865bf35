"""The node ``viewer`` in a graph, seen in a real browser: what comes is drawn, what falls silent
turns grey, and a button calls what the graph offers.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pianobot_msgs.action import DiagnoseGap, Investigate, PlayPhrase
from pianobot_msgs.msg import Candidate, Diagnosis, GapReport, Keystroke, KeystrokeGap, StageGap
from pianobot_msgs.srv import Adopt
from rclpy.action import ActionServer, CancelResponse
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger
from window_case import PATIENCE, Window, look

from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.domain import claim_domain
from pianobot_ros.nodes.watching import viewer, viewer_controls
from pianobot_ros.nodes.watching.viewer import Viewer
from pianobot_ros.piano.view import page as page_room
from pianobot_ros.piano.view.html_tables import QUIET
from pianobot_ros.piano.view.tape import tape as tape_room
from pianobot_ros.testing.browser import undrawn
from pianobot_ros.testing.running.emulated_device import EmulatedDevice
from pianobot_ros.testing.running.process import Processes
from pianobot_ros.testing.running.ros_context import Ros, on_this_machine

pytestmark = [pytest.mark.graph, pytest.mark.slow]
SENTENCE = "Missing effect: wrist_delay."


@dataclass
class ViewedGraph:
    """The viewer, a browser, and stand-ins for what the buttons call."""

    ros: Ros
    node: Viewer
    window: Window
    folder: Path
    asked: list[tuple[str, Any]] = field(default_factory=list)
    go_on: Future = field(default_factory=Future)
    """Until it is done, no job ends."""

    def __post_init__(self) -> None:
        self.go_on.set_result(None)

    def until(self, script: str) -> None:
        """Turn the graph until something holds in the browser; what is not there yet does not.

        The browser is asked once for each drawing of the page: a turn lets one callback in and
        takes a millisecond, an answer of a busy browser a second, and a drawing needs some sixty
        turns.
        """
        whole = f"(() => {{ try {{ return Boolean({script}) }} catch {{ return false }} }})()"
        asked_at = -1

        def holds() -> bool:
            nonlocal asked_at
            if self.node.page.drawings == asked_at:
                return False
            asked_at = self.node.page.drawings
            return bool(self.window.ask(whole))

        self.ros.wait_for(holds, script, PATIENCE)

    def answers(self, name: str, response: Any) -> Callable[[Any, Any], Any]:
        def called(request: Any, _: Any) -> Any:
            self.asked.append((name, request))
            return response

        return called

    def serve(self) -> None:
        """Stand-ins for the conductor, the diagnoser and the twin."""
        node = self.ros.node("graph")
        for kind, name, feedback in (
            (PlayPhrase, "play_phrase", PlayPhrase.Feedback(strike=2, total=9)),
            (
                DiagnoseGap,
                "diagnose_gap",
                DiagnoseGap.Feedback(stage="screening effects", progress=0.4),
            ),
            (
                Investigate,
                "investigate",
                Investigate.Feedback(doing="playing", strikes=3, budget=60, progress=0.05),
            ),
        ):

            async def execute(
                goal: Any, kind: Any = kind, name: str = name, said: Any = feedback
            ) -> Any:
                self.asked.append((name, goal.request))
                goal.publish_feedback(said)
                await self.go_on
                goal.succeed()
                return kind.Result(success=True, message=f"{name} is done")

            ActionServer(
                node,
                kind,
                f"/{name}",
                execute,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
        node.create_service(
            Adopt,
            "/sim_twin/adopt",
            self.answers("adopt", Adopt.Response(success=True, message="adopted wrist_delay")),
        )
        node.create_service(
            Trigger,
            "/sim_twin/forget",
            self.answers("forget", Trigger.Response(success=True, message="forgot everything")),
        )


@pytest.fixture(scope="module")
def graph(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewedGraph]:
    folder = tmp_path_factory.mktemp("reports")
    values = {"port": 0, "controls": True, "output": str(folder)}
    with pytest.MonkeyPatch.context() as patch, claim_domain() as domain:
        on_this_machine(patch)
        # A browser without a graphics card may be seconds behind.
        patch.setattr(viewer_controls, "ANSWER", PATIENCE)
        patch.setenv("ROS_DOMAIN_ID", str(domain.number))
        with Ros(domain.number) as ros:
            overrides = [Parameter(name, value=value) for name, value in values.items()]
            node = ros.add(Viewer(context=ros.context, parameter_overrides=overrides))
            made = ViewedGraph(ros, node, look(browser, node.page, "said", undrawn()), folder)
            made.serve()
            ros.wait_for(node._controls.ready, "what the buttons call")
            yield made
            made.window.view.close()  # a page that is left draws on, beside all tests that follow
            assert not made.window.errors


@pytest.mark.long
def test_a_killed_reader_turns_its_signal_grey_within_a_second_and_its_return_brings_it_back(
    graph: ViewedGraph, tmp_path: Path
) -> None:
    # What a second is made of: silence that counts, the page's delay, and the slowest drawing.
    beat = page_room.CHART_EVERY / float(graph.node.get_parameter("rate").value)
    assert tape_room.SILENT_AFTER + viewer.PAGE_DELAY + beat < 1.0
    state = "document.querySelector('[data-stream=\"real/fsr\"]').dataset.state"
    said = "document.querySelector('[data-stream=\"real/fsr\"]').innerText"
    with EmulatedDevice("fsr", tmp_path) as device, Processes(tmp_path) as processes:
        process = processes.node("fsr_reader", **device.parameters)
        graph.until(f"{state} == 'live'")
        process.end(signal.SIGKILL)
        ended = time.time()
        graph.until(f"{state} == 'silent'")
        assert "silent since" in graph.window.ask(said)
        since = graph.node.tape.silent_since("real", "fsr", time.time())
        assert since is not None and since <= ended
        graph.until(graph.window.drawn("force", QUIET))
        processes.node("fsr_reader", log="again", **device.parameters)
        graph.until(f"{state} == 'live'")


def test_a_row_and_a_point_after_each_strike(graph: ViewedGraph) -> None:
    publisher = graph.ros.publisher(GapReport, "/gap/live", common.EVENT_QOS)
    graph.ros.matched(publisher)
    for number in (1, 2):
        stroke = Keystroke(note=64, v_pre=0.1, v_rel=0.08, t_hold=0.4, peak_force=3.0)
        gap = KeystrokeGap(note=64, condition="soft", real=stroke, sim=stroke, err=0.043)
        report = GapReport(strike=number - 1, keystrokes=[gap])
        report.header.stamp = common.time_msg(time.time_ns())
        publisher.publish(report)
        graph.until(f"document.querySelectorAll('[data-strike]').length == {number}")
        graph.until(graph.window.chart("Err of Eq. 5", f"u.data[1].length == {number}"))
    assert "4.3 %" in graph.window.text("strikes")


def test_stage_map_then_who_leads_then_the_verdict_with_its_report(graph: ViewedGraph) -> None:
    window = graph.window
    publisher = graph.ros.publisher(Diagnosis, "/gap/diagnosis", common.LATCHED_QOS)
    graph.ros.matched(publisher)
    table = {"rows": ["wrist"], "columns": ["down", "up"], "values": [[7.5, None]]}
    stages = [StageGap(name="wrist", gap=7.5), StageGap(name="key", gap=float("nan"))]
    document = json.dumps({"stage_by_phase": table})
    publisher.publish(Diagnosis(sentence="not diagnosed yet", stages=stages, json=document))
    graph.until("document.querySelector('[data-part=map]').innerText.includes('7.5')")
    assert "last eight strikes" in window.text("map")
    publisher.publish(Diagnosis(candidates=[Candidate(name="wrist_delay", probability=0.62)]))
    graph.ros.wait_for(lambda: graph.node._leading, "who leads")
    graph.go_on = Future(executor=graph.ros.executor)
    window.press("diagnose")
    graph.until("(document.querySelector('[data-part=job]') || {}).innerText?.includes('62 %')")
    assert "screening effects" in window.text("job")
    graph.go_on.set_result(None)
    graph.until("document.querySelector('[data-part=job]') === null")
    assert window.view.get_by_role("button", name="Report").count() == 0

    report = graph.folder / "report.html"
    report.write_text(f"<!doctype html><title>r</title>{SENTENCE}", encoding="utf-8")
    found = {
        "verdict": "effect",
        "sentence": SENTENCE,
        "candidates": [{"name": "wrist_delay", "probability": 0.93}],
        "report": str(report),
    }
    publisher.publish(Diagnosis(verdict="effect", stages=stages, json=json.dumps(found)))
    graph.until(f"document.querySelector('[data-part=verdict]').innerText.includes('{SENTENCE}')")
    graph.until("[...document.querySelectorAll('button')].some(b => b.innerText == 'Report')")
    window.press("Report")
    graph.until("document.querySelector('a[download=\"report.html\"]') !== null")
    link = "document.querySelector('a[download=\"report.html\"]').href"
    assert SENTENCE in window.ask(f"fetch({link}).then(answer => answer.text())")


def test_each_button_calls_the_graph_and_shows_what_it_says(graph: ViewedGraph) -> None:
    window = graph.window
    (graph.folder / "diagnosis.json").unlink(missing_ok=True)
    asks = {n: n for n in ("investigate", "forget")}
    asks |= {"play": "play_phrase", "diagnose": "diagnose_gap"}
    says = {button: f"{name} is done" for button, name in asks.items()}
    says |= {"stop": "asked every job to end", "adopt": "diagnose first"}
    for button, words in (says | {"forget": "forgot everything"}).items():
        graph.asked.clear()
        window.press(button)
        said = "document.querySelector('[data-part=said]').innerText"
        graph.until(f"{said} == '{button}: {words}' || {said}.startsWith('{button}: {words}')")
        assert [asked for asked, _ in graph.asked] == ([asks[button]] if button in asks else [])
    (graph.folder / "diagnosis.json").write_text("{}", encoding="utf-8")
    graph.asked.clear()
    window.press("adopt")
    graph.until(f"{said} == 'adopt: adopted wrist_delay'")
    assert graph.asked[0][1].corrections == str(graph.folder / "diagnosis.json")
