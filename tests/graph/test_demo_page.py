"""``pianobot demo`` as a visitor sees it: one page in a real browser, from the first strike to the
twin that has adopted the verdict.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pianobot_ros.nodes.base.domain import claim_domain
from pianobot_ros.testing.browser import open_page, seldom, undrawn
from pianobot_ros.testing.running.alone import Alone
from pianobot_ros.testing.running.process import Processes

pytestmark = [pytest.mark.graph, pytest.mark.slow]

PATIENCE = 250.0  # s for each step, on a busy machine
SIZE = {"width": 640, "height": 200}  # px
POLL = 0.3  # s
PHRASE = """
strikes:
  - {note: 64, speed: 0.10, depth: 0.014, hold: 0.15, note_length: 0.8, repeats: 2}
  - {note: 64, speed: 0.20, depth: 0.014, hold: 0.15, note_length: 0.8, repeats: 2}
"""
UNHEARD = "strikes:\n  - {note: 64, speed: 0.15, depth: 0.014, hold: 0.15, repeats: 2}\n"
DEMO = """
import itertools
from pathlib import Path

import psutil

from pianobot_ros.cli.demo import closing_loop, requests
from pianobot_ros.cli.demo.demonstration import Script, run_demo

play, count = closing_loop.play_and_compare, itertools.count()
diagnose = requests.diagnose

def wait(gate, turn):
    while not Path(gate).exists():
        turn()

def gated(cell, phrase):
    number = next(count)
    wait(f"before-{number}", cell.turn)
    played = play(cell, phrase)
    wait(f"after-{number}", cell.turn)
    return played

def slowed(cell, bag, output):
    node = psutil.Process(cell.supervisor.pids["gap_diagnoser"])
    (worker,) = [c for c in node.children() if "spawn_main" in " ".join(c.cmdline())]
    turn = cell.turn

    def turned():
        turn()
        if "screening" in cell.note and not Path("job").exists():
            worker.suspend()
            wait("job", turn)
            worker.resume()

    cell.turn = turned
    return diagnose(cell, bag, output)

closing_loop.play_and_compare, requests.diagnose = gated, slowed
run_demo(
    seed=3, screen=False, diagnosis=True, run=Path("run"), domain=None, as_json=True,
    script=Script(
        "phrase.yaml",
        "unheard.yaml",
        {"gap_diagnoser": {"budget": 300}, "viewer": {"rate": 2.0}},
    ),
)
"""
"""The demo, short, which goes on when the browser has seen what there is to see."""
LOOK = """
window.seen = { jobs: [], maps: [], verdicts: [], lines: 0, corrected: false, report: false };
new MutationObserver(() => {
  const said = part => (document.querySelector(`[data-part=${part}]`) || {}).innerText || "";
  const keep = (list, text) => { if (text && list[list.length - 1] !== text) list.push(text); };
  keep(seen.jobs, said("job"));
  keep(seen.maps, said("map"));
  keep(seen.verdicts, said("verdict"));
  for (const { chart } of Object.values((window.__viserTestpoints || {}).uplots || {}))
    if (chart.root.innerText.includes("gap by stage") && chart.data[0].length > 1)
      seen.lines = Math.max(seen.lines, chart.data.length - 1);
  seen.corrected ||= document.body.innerText.includes("corrected twin");
  seen.report ||= [...document.querySelectorAll("button")].some(b => b.innerText === "Report");
}).observe(document, { subtree: true, childList: true, characterData: true });
"""
"""The browser itself notes what is seen: a busy one answers late."""


@pytest.mark.long
def test_one_page_shows_the_gap_its_diagnosis_the_verdict_and_the_corrected_twin(
    browser: Any, tmp_path: Path
) -> None:
    def go_on(*gates: str) -> None:
        for gate in gates:
            (tmp_path / gate).touch()

    (tmp_path / "phrase.yaml").write_text(PHRASE, encoding="utf-8")
    (tmp_path / "unheard.yaml").write_text(UNHEARD, encoding="utf-8")
    (tmp_path / "demo.py").write_text(DEMO, encoding="utf-8")
    with Alone(), claim_domain() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain.number)}
        with Processes(tmp_path, environment) as processes:
            demo = processes.python("demo", cwd=tmp_path)

            def address() -> str:
                lines = demo.output().splitlines()
                return next((x.split()[-1] for x in lines if x.startswith("in the browser: ")), "")

            processes.wait_for(address, demo.output, PATIENCE)
            view = open_page(browser, address(), "verdict", SIZE, LOOK + undrawn() + seldom(POLL))

            def see(script: str) -> None:
                view.wait_for_function(script, timeout=1e3 * PATIENCE, polling=1e3 * POLL)

            go_on("before-0")
            see("seen.lines >= 3")  # a line for each stage
            assert not view.evaluate("seen.corrected")
            see("seen.maps.some(text => text.includes('last eight strikes'))")
            go_on("after-0")
            # What the diagnosis does, how far it is, and who leads.
            see("seen.jobs.some(text => text.startsWith('screening') && text.includes('%'))")
            go_on("job")
            see("seen.verdicts.some(text => text.startsWith('Verdict: '))")
            see("seen.report")
            go_on("before-1", "after-1", "before-2")
            see("seen.corrected")
            go_on("after-2")
            assert demo.wait(PATIENCE) == 0, demo.output()
            sentence = json.loads((tmp_path / "run" / "summary.json").read_text())["diagnosis"]
            assert sentence["sentence"] in view.evaluate("seen.verdicts.join()")
            view.close()
