"""The RTDE variables of a controller: names, types and current values.

Source: Universal Robots, "RTDE Guide", tables of outputs and inputs. A type that differs from the
client's own table is misread silently, so the tables follow the guide to the letter.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from pianobot_ros.devices.wrist.rtde.wire import FORMATS, LENGTHS

__all__ = ["REGISTERS", "InputRecipe", "Inputs", "OutputRecipe", "Outputs"]

REGISTERS = 48
"""General-purpose registers of each kind. The upper 24 are meant for RTDE clients, the lower for
field buses.
"""

_OUTPUTS: dict[str, str] = {
    **dict.fromkeys(
        [
            "timestamp",
            "actual_execution_time",
            "speed_scaling",
            "target_speed_fraction",
            "actual_momentum",
            "actual_main_voltage",
            "actual_robot_voltage",
            "actual_robot_current",
            "standard_analog_input0",
            "standard_analog_input1",
            "standard_analog_output0",
            "standard_analog_output1",
            "io_current",
            "payload",
            "tool_analog_input0",
            "tool_analog_input1",
            "tool_output_current",
            "tool_temperature",
            "tcp_force_scalar",
        ],
        "DOUBLE",
    ),
    **dict.fromkeys(
        [
            "target_q",
            "target_qd",
            "target_qdd",
            "target_current",
            "target_moment",
            "actual_q",
            "actual_qd",
            "actual_current",
            "joint_control_output",
            "actual_TCP_pose",
            "actual_TCP_speed",
            "actual_TCP_force",
            "target_TCP_pose",
            "target_TCP_speed",
            "joint_temperatures",
            "actual_joint_voltage",
            "payload_inertia",
            "tcp_offset",
        ],
        "VECTOR6D",
    ),
    **dict.fromkeys(
        ["actual_tool_accelerometer", "payload_cog", "elbow_position", "elbow_velocity"], "VECTOR3D"
    ),
    **dict.fromkeys(
        [
            "runtime_state",
            "robot_status_bits",
            "safety_status_bits",
            "analog_io_types",
            "tool_analog_input_types",
            "output_bit_registers0_to_31",
            "output_bit_registers32_to_63",
        ],
        "UINT32",
    ),
    **dict.fromkeys(
        ["robot_mode", "safety_mode", "safety_status", "tool_output_voltage", "tool_mode"], "INT32"
    ),
    "actual_digital_input_bits": "UINT64",
    "actual_digital_output_bits": "UINT64",
    "joint_mode": "VECTOR6INT32",
    **{f"output_int_register_{i}": "INT32" for i in range(REGISTERS)},
    **{f"output_double_register_{i}": "DOUBLE" for i in range(REGISTERS)},
}

_E_SERIES_OUTPUTS = {"ft_raw_wrench": "VECTOR6D"}

_INPUTS: dict[str, str] = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    **dict.fromkeys(
        [
            "standard_digital_output_mask",
            "standard_digital_output",
            "configurable_digital_output_mask",
            "configurable_digital_output",
            "tool_digital_output_mask",
            "tool_digital_output",
            "standard_analog_output_mask",
            "standard_analog_output_type",
        ],
        "UINT8",
    ),
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    "input_bit_registers0_to_31": "UINT32",
    "input_bit_registers32_to_63": "UINT32",
    **{f"input_int_register_{i}": "INT32" for i in range(REGISTERS)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(REGISTERS)},
}


def _zero(kind: str) -> Any:
    if kind in LENGTHS:
        return [0.0 if FORMATS[kind].endswith("d") else 0] * LENGTHS[kind]
    return 0.0 if kind == "DOUBLE" else 0


class Outputs:
    """What the controller tells: ``values`` by name, vectors as sequences of floats."""

    def __init__(self, e_series: bool) -> None:
        self.types = {**_OUTPUTS, **(_E_SERIES_OUTPUTS if e_series else {})}
        self.values: dict[str, Any] = {name: _zero(kind) for name, kind in self.types.items()}


class OutputRecipe:
    """The list of outputs that one client wants, packed into one message at a time."""

    def __init__(self, outputs: Outputs, names: Sequence[str]) -> None:
        self._values = outputs.values
        self._names = list(names)
        self.kinds = [outputs.types.get(name, "NOT_FOUND") for name in names]
        self.valid = bool(names) and "NOT_FOUND" not in self.kinds
        self._struct = struct.Struct(">" + "".join(FORMATS.get(kind, "") for kind in self.kinds))

    def pack(self) -> bytes:
        """The current values."""
        flat: list[Any] = []
        for name in self._names:
            value = self._values[name]
            if isinstance(value, (int, float)):
                flat.append(value)
            else:
                flat.extend(value)
        return self._struct.pack(*flat)


class Inputs:
    """What clients may set: values by name, and which client holds each name."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {name: _zero(kind) for name, kind in _INPUTS.items()}
        self._holders: dict[str, object] = {}

    def kinds(self, names: Sequence[str], client: object) -> list[str]:
        """Type of each name, or NOT_FOUND, or IN_USE where another client holds it."""
        free = [self._holders.get(name, client) is client for name in names]
        return [
            ("IN_USE" if not is_free else _INPUTS[name]) if name in _INPUTS else "NOT_FOUND"
            for name, is_free in zip(names, free, strict=True)
        ]

    def hold(self, names: Sequence[str], client: object) -> None:
        """Reserve the names for a client."""
        self._holders.update(dict.fromkeys(names, client))

    def release(self, client: object) -> None:
        """Free every name that the client held."""
        self._holders = {
            name: holder for name, holder in self._holders.items() if holder is not client
        }


class InputRecipe:
    """A list of inputs that one client sets together."""

    def __init__(self, names: Sequence[str], kinds: Sequence[str]) -> None:
        self.names = tuple(names)
        self._lengths = [LENGTHS.get(kind, 1) for kind in kinds]
        self._struct = struct.Struct(">" + "".join(FORMATS[kind] for kind in kinds))

    def apply(self, payload: bytes, inputs: Inputs) -> bool:
        """Store the values of one message. False if its length does not fit the recipe (a short or
        long pose).
        """
        if len(payload) != self._struct.size:
            return False
        flat = self._struct.unpack(payload)
        position = 0
        for name, length in zip(self.names, self._lengths, strict=True):
            inputs.values[name] = (
                flat[position] if length == 1 else list(flat[position : position + length])
            )
            position += length
        return True
