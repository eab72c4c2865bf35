"""Every number of every file of the configuration: whatever else stands there is refused.

The numbers are found in the files themselves, so a new field is tried without a change here; a new
file needs a line in LOADERS.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import Hand, Keyboard
from pianobot_ros.cell.numbers.config import (
    Section,
    config_dir,
    load_provenance,
    load_section,
    load_yaml,
)
from pianobot_ros.cell.numbers.learned import Learned
from pianobot_ros.cell.numbers.nominal import StiffnessCalibration, WristServo
from pianobot_ros.cell.score import load_score
from pianobot_ros.devices.fsr import FsrConfig
from pianobot_ros.devices.midi import MidiConfig
from pianobot_ros.devices.vacuum import RegulatorConfig
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.emulator.plant.instruments.sensor_noise import SensorNoise
from pianobot_ros.emulator.plant.mechanics.physics import Physics
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.gap.evidence.session_clocks import Lag
from pianobot_ros.piano.gap.evidence.time_stamps import Scatter, Stamps
from pianobot_ros.piano.identify.priors import _File as Priors

Place = tuple[str | int, ...]
Loader = Callable[[Path], object]


def by(model: type[Section], key: str | None = None) -> Loader:
    return lambda path: load_section(path, model, key)


LOADERS: dict[str, Loader] = {
    "action.yaml": by(ActionParameters),
    "calibration/axis.yaml": by(Learned),
    "calibration/diagnosis.yaml": by(Learned),
    "calibration/stiffness.yaml": by(StiffnessCalibration),
    "fsr.yaml": FsrConfig.load,
    "hand.yaml": by(Hand),
    "keyboard.yaml": by(Keyboard),
    "link.yaml: lag": by(Lag, "lag"),
    "link.yaml: scatter": by(Scatter, "scatter"),
    "link.yaml: stamps": by(Stamps, "stamps"),
    "midi.yaml": MidiConfig.load,
    "plant.yaml: effects": load_provenance,
    "plant.yaml: noise": by(SensorNoise, "noise"),
    "plant.yaml: physics": by(Physics, "physics"),
    "priors.yaml": by(Priors),
    "vacuum.yaml": RegulatorConfig.load,
    "wrist.yaml": UrConfig.load,
    "wrist_model.yaml: servo": by(WristServo, "servo"),
    "wrist_model.yaml: sensor_rate": load_provenance,
}
"""What reads a file, or one section of it."""

NO_NUMBERS = ("true", '"1"', ".inf", ".nan")


def numbers(node: Any, place: Place = ()) -> Iterator[Place]:
    """Where the numbers are."""
    if isinstance(node, dict):
        for name, child in node.items():
            yield from numbers(child, (*place, name))
    elif isinstance(node, list):
        for i, child in enumerate(node):
            yield from numbers(child, (*place, i))
    elif isinstance(node, (int, float)) and not isinstance(node, bool):
        yield place


def replaced(data: dict[str, Any], place: Place, word: str) -> str:
    """The data as YAML, with ``word`` at a place."""
    changed: dict[str, Any] = deepcopy(data)
    node: Any = changed
    for step in place[:-1]:
        node = node[step]
    node[place[-1]] = "HERE"
    return json.dumps(changed).replace('"HERE"', word)


def reader_of(file: str, data: dict[str, Any], place: Place) -> tuple[Loader, dict[str, Any]]:
    """What reads the number at a place, and as much of the file as that needs."""
    if file.startswith("phrases/"):
        return load_score, data
    if file in LOADERS:
        return LOADERS[file], data
    section, load = data[place[0]], LOADERS[f"{file}: {place[0]}"]
    if load is load_provenance and len(place) > 2:  # each of hundreds stands for itself
        section = {place[1]: section[place[1]]}
    return load, {str(place[0]): section}


FILES = sorted(str(p.relative_to(config_dir())) for p in config_dir().rglob("*.yaml"))


@pytest.mark.parametrize("file", FILES)
def test_no_number_of_the_configuration_may_be_anything_else(file: str, tmp_path: Path) -> None:
    data = load_yaml(config_dir() / file)
    copy = tmp_path / Path(file).name
    accepted, unclear, places = [], [], list(numbers(data))
    for i, place in enumerate(places):
        load, part = reader_of(file, data, place)
        for word in (*NO_NUMBERS[:2], NO_NUMBERS[2 + i % 2]):
            copy.write_text(replaced(part, place, word), encoding="utf-8")
            try:
                load(copy)
            except PianobotError as error:
                names = [step for step in place if isinstance(step, str) and step != "value"]
                said = str(error)
                if copy.name not in said or names[-1] not in said or "\n" in said:
                    unclear.append((place, word, said))
            else:
                accepted.append((place, word))
    assert places and not accepted and not unclear


# Numbers that are numbers, in the right unit, and describe no hand, no key and no sensor.
IMPOSSIBLE = [
    ("hand.yaml", "fingers/index/radius", 0.0, "radius: Input should be greater than 0"),
    ("hand.yaml", "fingers/index/radius", 7.0, "radius: Input should be less than or equal to 1"),
    ("hand.yaml", "fingers/thumb/lengths", [0.04, -0.02, 0.02], "lengths.1"),
    ("hand.yaml", "fingers/thumb/lengths", [0.04, 0.02], "2 lengths and 2 bends"),
    ("hand.yaml", "fingers/thumb/yaw", 45.0, "yaw"),
    ("hand.yaml", "palm/size", [0.07, 0.0, 0.02], "size.1"),
    ("hand.yaml", "density", 0.0, "density"),
    ("keyboard.yaml", "white/pitch", 23.5, "white.pitch"),
    ("keyboard.yaml", "white/pivot", 0.0, "white.pivot"),
    ("keyboard.yaml", "mechanism/rest_stiffness", 0.0, "rest_stiffness"),
    ("keyboard.yaml", "mechanism/reference_radius", 0.3, "before the key's front"),
    ("keyboard.yaml", "midi/trigger_on", 0.05, "no key would sound"),
    ("keyboard.yaml", "midi/trigger_off", 0.04, "end before it begins"),
    ("keyboard.yaml", "strike_point/white", 0.3, "behind the hinge"),
    ("keyboard.yaml", "black/front", 0.09, "before the black keys"),
    ("fsr.yaml", "sensor/bits", 10, "more than a converter of 10 bits can say (1023)"),
    ("wrist.yaml", "mount/home", [0.0, 0.27, 0.5], "mount.home is at z = 0.5 m"),
    ("calibration/stiffness.yaml", "pressure", [0, -50000], "same length"),
    ("calibration/stiffness.yaml", "pressure", [0, -50000, -50000], "stand there once"),
    ("calibration/stiffness.yaml", "stiffness", [0.0, 15.5, 28.65], "above 0"),
]


@pytest.mark.parametrize(("file", "name", "value", "says"), IMPOSSIBLE)
def test_what_describes_no_cell_is_refused_where_it_is_read(
    file: str, name: str, value: object, says: str, tmp_path: Path
) -> None:
    data: dict[str, Any] = load_yaml(config_dir() / file)
    node = data
    for step in name.split("/"):
        node = node[step]
    node["value"] = value
    copy = tmp_path / Path(file).name
    copy.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(PianobotError) as error:
        LOADERS[file](copy)
    assert says in str(error.value) and copy.name in str(error.value)
    assert "\n" not in str(error.value)
