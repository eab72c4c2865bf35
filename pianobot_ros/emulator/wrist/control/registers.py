"""The registers through which the control script and its client talk."""

from __future__ import annotations

from typing import Any

import numpy as np

from pianobot_ros.emulator.wrist.motion.kinematics import Array

__all__ = ["Registers"]

_DOUBLES = 12  # registers that the longest command fills


class Registers:
    """The client's and the script's registers of one run.

    Args:
        inputs, outputs: the controller's variables by name.
        offset: index of the script's first register of each kind.
    """

    def __init__(self, inputs: dict[str, Any], outputs: dict[str, Any], offset: int) -> None:
        self._inputs, self._outputs, self._offset = inputs, outputs, offset
        self._write_count = self._operation = 0
        # the client's names, which would otherwise be spelt anew in each cycle
        self._doubles = tuple(f"input_double_register_{i + offset}" for i in range(_DOUBLES))
        self.command = f"input_int_register_{offset}"
        """Name of the input that holds the command's number."""

    def double(self, index: int) -> float:
        """A number that the client wrote."""
        return float(self._inputs[self._doubles[index]])

    def doubles(self, first: int = 0) -> Array:
        """Six numbers that the client wrote, (6,)."""
        return np.array([self._inputs[name] for name in self._doubles[first : first + 6]], float)

    def integer(self, index: int) -> int:
        """A whole number that the client wrote."""
        return int(self._inputs[f"input_int_register_{index + self._offset}"])

    def answer(self, values: Array) -> None:
        """Numbers for the client, from the first register on."""
        for index, value in enumerate(values):
            self._outputs[f"output_double_register_{index + self._offset}"] = float(value)

    def answer_integer(self, value: int) -> None:
        """A whole number for the client."""
        self._outputs[f"output_int_register_{1 + self._offset}"] = int(value)

    def ready(self, value: int) -> None:
        """Whether the command is being awaited (1) or done (2)."""
        self._outputs[f"output_int_register_{self._offset}"] = value

    def progress(self, value: int) -> None:
        """The register that tells how far an asynchronous move is: counters, a running bit and the
        progress.
        """
        self._write_count = (self._write_count + 1) % 128
        if value == 0:
            self._operation = (self._operation + 1) % 128
        running = 32768 + min(value, 32767) if value >= 0 else 0
        self._outputs[f"output_int_register_{2 + self._offset}"] = (
            self._write_count * 65536 + self._operation * 16777216 + running
        )
