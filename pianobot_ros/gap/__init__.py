"""Gap diagnosis for any robot and its simulated twin: where, which effect, how far. No piano and no
ROS in here.

Give `diagnose` a `Twin` and `Block`s; it returns a `Diagnosis`. See docs/diagnosis.md for how to
read it, docs/diagnosis-method.md for the statistics and docs/tutorial-your-robot.md for a third
robot in under 100 lines.
"""

from pianobot_ros.gap.diagnosis import (
    Candidate,
    Closure,
    Diagnosis,
    Estimate,
    FoundEffect,
    Measure,
    Offer,
    Trace,
)
from pianobot_ros.gap.engine import diagnose
from pianobot_ros.gap.explain.experiment import Proposal, propose_experiment
from pianobot_ros.gap.floor.scatter import departures
from pianobot_ros.gap.problem.errors import GapError, SimulationFailed
from pianobot_ros.gap.problem.options import Calibration, Options, Scaling
from pianobot_ros.gap.problem.types import Block, Effect, Observable, Parameter, Signal, Stage, Twin
from pianobot_ros.gap.search.twin_check import TwinCheck, check_twin

__all__ = [
    "Block",
    "Calibration",
    "Candidate",
    "Closure",
    "Diagnosis",
    "Effect",
    "Estimate",
    "FoundEffect",
    "GapError",
    "Measure",
    "Observable",
    "Offer",
    "Options",
    "Parameter",
    "Proposal",
    "Scaling",
    "Signal",
    "SimulationFailed",
    "Stage",
    "Trace",
    "Twin",
    "TwinCheck",
    "check_twin",
    "departures",
    "diagnose",
    "propose_experiment",
]
