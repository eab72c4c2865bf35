"""Parameters with a description and a checked range, and a time at which they may be changed.

A value that would not be obeyed is refused, with the reason: one outside its range or choices, and
one that the node read before and does not look at again. One that was taken outlasts the process,
should it die: who is started in its place has it too.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.host.marks import LEGACY

__all__ = ["check_overrides", "declare", "keep_changes", "keep_wall_time"]

ValueT = TypeVar("ValueT", bool, int, float, str, "list[str]", "list[float]")

Changes = Literal["start", "configured", "any"]
"""Until when a new value is obeyed: the node's start, its next configuration, any time."""

# Parameters that rclpy itself declares, or that it reads before a node can declare them.
_FOREIGN = ("qos_overrides.", "use_sim_time", "start_type_description_service")
_CHANGED = "parameters"  # name in the legacy


def declare(
    node: Node,
    name: str,
    default: ValueT,
    description: str,
    low: float | None = None,
    high: float | None = None,
    *,
    choices: Sequence[str] | None = None,
    changes: Changes | None = None,
) -> ValueT:
    """Declare a parameter and return its value; a method of every node.

    Args:
        node: the node that owns it.
        name: its name.
        default: its default, which also fixes its type.
        description: one sentence with the unit, shown by ``ros2 param describe``.
        low: smallest allowed value of a number, inclusive.
        high: largest allowed value of a number, inclusive.
        choices: the allowed values of a string, or of each in a list.
        changes: when a new value is obeyed; by default when the node is configured, or, if it has
            no lifecycle, only at its start.

    Raises:
        ConfigError: the value given from outside has the wrong type or is out of range.
    """
    lifecycle = isinstance(node, LifecycleNode)
    changes = changes or ("configured" if lifecycle else "start")
    descriptor = ParameterDescriptor(
        name=name, description=description, read_only=changes == "start"
    )
    allowed = _describe_range(descriptor, default, low, high, choices)
    _accept_whole_numbers(node, name, default)
    if changes != "start" and name in (changed := LEGACY.get(_CHANGED) or {}):
        node._parameter_overrides[name] = Parameter(name, value=changed[name])
    try:
        value = node.declare_parameter(name, default, descriptor).value
    except InvalidParameterTypeException as error:
        given = node._parameter_overrides[name].value
        raise ConfigError(
            f"{node.get_name()}: parameter '{name}' must be {_kind(default)}, not {given!r}"
            f" ({description})"
        ) from error
    except InvalidParameterValueException as error:
        given = node._parameter_overrides[name].value
        raise ConfigError(
            f"{node.get_name()}: parameter '{name}' is {given!r}, must be {allowed} ({description})"
        ) from error
    rule = _Rule(name, choices, default != "", changes == "configured", node)
    if reason := rule.wrong(value):
        raise ConfigError(f"{node.get_name()}: {reason}")
    node.add_on_set_parameters_callback(rule)
    return value


@dataclass(frozen=True)
class _Rule:
    """What rclpy does not check when a parameter is set: choices, and the node's state."""

    name: str
    choices: Sequence[str] | None
    filled: bool  # an empty string means nothing
    configured: bool  # only read when the node is configured
    node: Node

    def wrong(self, value: Any) -> str:
        """Why the node could not obey the value at any time; empty if it could."""
        if self.filled and value == "":
            return f"parameter '{self.name}' is empty"
        for one in value if isinstance(value, (list, tuple, array)) else [value]:
            if isinstance(one, float) and not math.isfinite(one):
                return f"parameter '{self.name}' is {one}: give a finite number"
            if self.choices is not None and one not in self.choices:
                return unknown_name(f"value of parameter '{self.name}'", str(one), self.choices)
        return ""

    def __call__(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """The callback of rclpy."""
        for parameter in parameters:
            if parameter.name != self.name:
                continue
            reason = self.wrong(parameter.value)
            state = getattr(self.node, "state", "unconfigured")
            if not reason and self.configured and state != "unconfigured":
                reason = (
                    f"parameter '{self.name}' is read when the node is configured, and it is"
                    f" {state}: clean it up first"
                )
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def keep_changes(node: Node) -> None:
    """Leave every later change to the process that is started in the place of this one, should it
    die; and say which this one got so.
    """
    changed = dict(LEGACY.get(_CHANGED) or {})
    if changed:
        told = ", ".join(f"{name} = {value}" for name, value in changed.items())
        node.get_logger().warning(
            f"started in place of one that died, with what it was set to: {told}"
        )

    def keep(parameters: Sequence[Parameter]) -> None:
        for one in parameters:
            if not one.name.startswith(_FOREIGN):
                value = one.value
                changed[one.name] = list(value) if isinstance(value, (array, tuple)) else value
        LEGACY.keep(_CHANGED, changed)

    node.add_post_set_parameters_callback(keep)


def keep_wall_time(node: Node) -> None:
    """Refuse simulated time: the cell's devices and loops live on the wall clock, as their stamps
    do, and timers that wait for a clock that nobody publishes never come.

    Raises:
        ConfigError: ``use_sim_time`` is given from outside.
    """
    reason = "parameter 'use_sim_time' must stay false: the cell keeps wall time, as its stamps do"
    if node.get_parameter("use_sim_time").value:
        raise ConfigError(f"{node.get_name()}: {reason}")

    def refuse(parameters: Sequence[Parameter]) -> SetParametersResult:
        wanted = any(p.name == "use_sim_time" and p.value for p in parameters)
        return SetParametersResult(successful=not wanted, reason=reason if wanted else "")

    node.add_on_set_parameters_callback(refuse)


def check_overrides(node: Node) -> None:
    """Refuse parameters given from outside that the node never declared: most often a typing error
    in a YAML file.

    Raises:
        ConfigError: names the unknown parameter and the nearest known one.
    """
    declared = set(node._parameters)
    for name in node._parameter_overrides:
        if name not in declared and not name.startswith(_FOREIGN):
            raise ConfigError(
                f"{node.get_name()}: " + unknown_name("parameter", name, _own(declared))
            )


def _own(names: Iterable[str]) -> list[str]:
    return [name for name in names if not name.startswith(_FOREIGN)]


def _describe_range(
    descriptor: ParameterDescriptor,
    default: Any,
    low: float | None,
    high: float | None,
    choices: Sequence[str] | None,
) -> str:
    """Fill the range into the descriptor and return it in words."""
    if choices is not None:
        descriptor.additional_constraints = "one of " + ", ".join(choices)
        return descriptor.additional_constraints
    if (low is None and high is None) or isinstance(default, (bool, str, list)):
        return "valid"
    if isinstance(default, int):
        limit = 2**62
        whole = IntegerRange(
            from_value=int(-limit if low is None else low),
            to_value=int(limit if high is None else high),
        )
        descriptor.integer_range = [whole]
    else:
        real = FloatingPointRange(
            from_value=-math.inf if low is None else float(low),
            to_value=math.inf if high is None else float(high),
        )
        descriptor.floating_point_range = [real]
    if low is None:
        return f"at most {high:g}"
    return f"at least {low:g}" if high is None else f"in [{low:g}, {high:g}]"


def _accept_whole_numbers(node: Node, name: str, default: Any) -> None:
    """Let ``rate:=1`` mean 1.0 where a float is wanted; rclpy alone would refuse it."""
    given = node._parameter_overrides.get(name)
    if isinstance(default, float) and given is not None and given.type_ == Parameter.Type.INTEGER:
        node._parameter_overrides[name] = Parameter(name, Parameter.Type.DOUBLE, float(given.value))


def _kind(default: Any) -> str:
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}
    return names.get(type(default), f"a {type(default).__name__}")
