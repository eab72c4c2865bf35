"""A parameter is obeyed, or its change is refused with the reason."""

from __future__ import annotations

from typing import Any

import pytest

from pianobot_ros.cell.errors import ConfigError

pytestmark = pytest.mark.graph

NODES = {
    "conductor": "Conductor",
    "fsr_reader": "FsrReader",
    "gap_diagnoser": "GapDiagnoser",
    "gap_monitor": "GapMonitor",
    "midi_bridge": "MidiBridge",
    "optimizer": "Optimizer",
    "recorder": "Recorder",
    "ur5_wrist": "Ur5Wrist",
    "vacuum_regulator": "VacuumRegulator",
}


def make(ros: Any, name: str, **parameters: Any) -> Any:
    from importlib import import_module

    from rclpy.parameter import Parameter

    from pianobot_ros.nodes.graph import MODULES

    module = import_module(MODULES[name])
    kind = getattr(module, NODES[name])
    overrides = [Parameter("autostart", value=False)] if name in HARDWARE else []
    overrides += [Parameter(n, value=v) for n, v in parameters.items()]
    return ros.add(kind(context=ros.context, parameter_overrides=overrides))


HARDWARE = ("fsr_reader", "midi_bridge", "ur5_wrist", "vacuum_regulator")


def refusal(node: Any, name: str, value: Any) -> str:
    """Why the node refuses the value; empty if it takes it."""
    from rclpy.parameter import Parameter

    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert result.successful == (not result.reason)
    return str(result.reason)


@pytest.mark.parametrize(
    ("node", "name", "value", "says"),
    [
        ("fsr_reader", "clock", "nonsense", "arrival, fixed, tracked"),
        ("fsr_reader", "rate", float("nan"), "rate"),
        ("fsr_reader", "rate", float("inf"), "rate"),
        ("fsr_reader", "rate", True, "type"),
        ("fsr_reader", "note", 200, "note"),
        ("midi_bridge", "transport", "smoke", "socket"),
        ("ur5_wrist", "host", "", "empty"),
        ("ur5_wrist", "config", "other.yaml", "read-only"),
        ("vacuum_regulator", "stale_time", -1.0, "stale_time"),
        ("conductor", "rate", 100.0, "read-only"),
        ("conductor", "transpose", 61, "transpose"),
        ("conductor", "require", ["left"], "read-only"),
    ],
)
def test_what_would_not_be_obeyed_is_refused(
    ros: Any, node: str, name: str, value: Any, says: str
) -> None:
    made = make(ros, node)
    before = made.get_parameter(name).value
    assert says in refusal(made, name, value)
    assert made.get_parameter(name).value == before


def test_what_is_read_at_configuration_is_not_taken_after_it(ros: Any) -> None:
    from rclpy.lifecycle import TransitionCallbackReturn

    from pianobot_ros.nodes.base import common

    class Device(common.DeviceNode):
        def __init__(self, **options: Any) -> None:
            super().__init__("device", **options)
            self.declare("speed", 1.0, "m/s", 0.0, 2.0)
            self.declare("colour", "red", "of the lamp", changes="any")

    from rclpy.parameter import Parameter

    device = ros.add(
        Device(context=ros.context, parameter_overrides=[Parameter("autostart", value=False)])
    )
    assert not refusal(device, "speed", 1.5)
    assert device.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "inactive: clean it up first" in refusal(device, "speed", 0.5)
    assert not refusal(device, "colour", "blue")
    device.trigger_cleanup()
    assert not refusal(device, "speed", 0.5)


@pytest.mark.parametrize(
    ("node", "parameters", "says"),
    [
        ("conductor", {"require": ["left"]}, "'left'"),
        ("fsr_reader", {"clock": "fixd"}, "did you mean 'fixed'"),
        ("ur5_wrist", {"host": ""}, "'host' is empty"),
        ("conductor", {"lead": float("nan")}, "lead"),
    ],
)
def test_a_bad_value_at_the_start_is_refused(
    ros: Any, node: str, parameters: dict[str, Any], says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        make(ros, node, **parameters)


def test_every_number_declares_its_range_and_every_parameter_its_meaning(ros: Any) -> None:
    from rclpy.parameter import Parameter

    for name in ("conductor", "gap_monitor", *HARDWARE):
        node = make(ros, name)
        for parameter in node._parameters.values():
            described = node.describe_parameter(parameter.name)
            if parameter.name.startswith(("use_sim_time", "start_type", "qos_overrides")):
                continue
            assert described.description, parameter.name
            if parameter.type_ == Parameter.Type.INTEGER:
                assert described.integer_range, parameter.name
            if parameter.type_ == Parameter.Type.DOUBLE:
                assert described.floating_point_range, parameter.name
