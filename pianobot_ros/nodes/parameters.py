"""Parameters with a description and a checked range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from pianobot_ros.cell.errors import ConfigError, unknown_name

__all__ = ["check_overrides", "declare"]

ValueT = TypeVar("ValueT", bool, int, float, str, "list[str]", "list[float]")

# Parameters that rclpy itself declares, or that it reads before a node can declare them.
_FOREIGN = ("qos_overrides.", "use_sim_time", "start_type_description_service")


def declare(
    node: Node,
    name: str,
    default: ValueT,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] | None = None,
    read_only: bool = False,
) -> ValueT:
    """Declare a parameter and return its value.

    Args:
        node: the node that owns it.
        name: its name.
        default: its default, which also fixes its type.
        description: one sentence with the unit, shown by ``ros2 param describe``.
        low: smallest allowed value of a number, inclusive.
        high: largest allowed value of a number, inclusive.
        choices: the allowed values of a string.
        read_only: True if the value is only read at start-up.

    Raises:
        ConfigError: the value given from outside has the wrong type or is out of range.
    """
    descriptor = ParameterDescriptor(name=name, description=description, read_only=read_only)
    allowed = _describe_range(descriptor, default, low, high, choices)
    _accept_whole_numbers(node, name, default)
    try:
        value = node.declare_parameter(name, default, descriptor).value
    except InvalidParameterTypeException as error:
        given = node._parameter_overrides[name].value
        raise ConfigError(
            f"{node.get_name()}: parameter '{name}' must be {_kind(default)}, not {given!r} ({description})"
        ) from error
    except InvalidParameterValueException as error:
        given = node._parameter_overrides[name].value
        raise ConfigError(
            f"{node.get_name()}: parameter '{name}' is {given!r}, must be {allowed} ({description})"
        ) from error
    if choices is not None and value not in choices:
        raise ConfigError(f"{node.get_name()}: " + unknown_name(f"value of parameter '{name}'", str(value), choices))
    return value


def check_overrides(node: Node) -> None:
    """Refuse parameters given from outside that the node never declared: most often a typing error in a YAML file.

    Raises:
        ConfigError: names the unknown parameter and the nearest known one.
    """
    declared = set(node._parameters)
    for name in node._parameter_overrides:
        if name not in declared and not name.startswith(_FOREIGN):
            raise ConfigError(f"{node.get_name()}: " + unknown_name("parameter", name, _own(declared)))


def _own(names: Iterable[str]) -> list[str]:
    return [name for name in names if not name.startswith(_FOREIGN)]


def _describe_range(
    descriptor: ParameterDescriptor, default: Any, low: float | None, high: float | None, choices: Sequence[str] | None
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
            from_value=int(-limit if low is None else low), to_value=int(limit if high is None else high)
        )
        descriptor.integer_range = [whole]
    else:
        real = FloatingPointRange(
            from_value=-math.inf if low is None else float(low), to_value=math.inf if high is None else float(high)
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
