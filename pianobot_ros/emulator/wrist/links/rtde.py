"""One RTDE client: negotiation, recipes, and the data that goes both ways."""

from __future__ import annotations

import struct
from collections.abc import Callable

from pianobot_ros.devices.wrist.rtde.wire import Framer, MessageType, frame
from pianobot_ros.emulator.wrist.control.controller import Controller
from pianobot_ros.emulator.wrist.control.variables import InputRecipe, OutputRecipe

__all__ = ["RtdeSession"]


class RtdeSession:
    """State of one connection on port 30004.

    Args:
        controller: where inputs go and outputs come from.
        send: sends bytes to the client.
        log: gets one line for each event.
    """

    def __init__(
        self, controller: Controller, send: Callable[[bytes], None], log: Callable[[str], None]
    ) -> None:
        self._controller, self._send, self._log = controller, send, log
        self._framer = Framer()
        self._inputs: dict[int, InputRecipe] = {}
        self._outputs: OutputRecipe | None = None
        self._every = 1  # cycles between two packages
        self._countdown = 0
        self.started = False

    def receive(self, data: bytes, now: float) -> None:
        """Handle what the client sent. Raises ValueError if the stream cannot be followed."""
        for kind, payload in self._framer.feed(data):
            self._handle(kind, payload, now)

    def package(self) -> bytes | None:
        """The data package of this cycle, or None if the client wants none now."""
        if not self.started or self._outputs is None:
            return None
        self._countdown -= 1
        if self._countdown > 0:
            return None
        self._countdown = self._every
        return frame(MessageType.DATA_PACKAGE, b"\x01" + self._outputs.pack())

    def close(self) -> None:
        """Free the inputs that the client held."""
        self._controller.inputs.release(self)

    def _handle(self, kind: int, payload: bytes, now: float) -> None:
        if kind == MessageType.DATA_PACKAGE:
            self._data(payload, now)
        elif kind == MessageType.REQUEST_PROTOCOL_VERSION:
            wanted = struct.unpack(">H", payload)[0]
            self._send(frame(kind, bytes([wanted == 2])))
        elif kind == MessageType.GET_CONTROLLER_VERSION:
            self._send(frame(kind, struct.pack(">4I", *self._controller.model.version)))
        elif kind == MessageType.SETUP_OUTPUTS:
            self._setup_outputs(payload)
        elif kind == MessageType.SETUP_INPUTS:
            self._setup_inputs(payload)
        elif kind in (MessageType.START, MessageType.PAUSE):
            self.started = kind == MessageType.START and self._outputs is not None
            self._countdown = 0
            self._send(frame(kind, bytes([self.started or kind == MessageType.PAUSE])))
        else:
            self._log(f"RTDE message of unknown type {kind} ignored")

    def _setup_outputs(self, payload: bytes) -> None:
        frequency = struct.unpack(">d", payload[:8])[0]
        recipe = OutputRecipe(self._controller.outputs, _names(payload[8:]))
        if recipe.valid:
            self._outputs = recipe
            self._every = max(1, round(self._controller.model.rate / max(frequency, 1.0)))
        else:
            self._log(
                f"RTDE outputs refused: {','.join(_names(payload[8:]))}: {','.join(recipe.kinds)}"
            )
        self._send(
            frame(
                MessageType.SETUP_OUTPUTS, bytes([recipe.valid]) + ",".join(recipe.kinds).encode()
            )
        )

    def _setup_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        kinds = self._controller.inputs.kinds(names, self)
        identifier = 0
        if not {"NOT_FOUND", "IN_USE"} & set(kinds):
            identifier = len(self._inputs) + 1
            self._inputs[identifier] = InputRecipe(names, kinds)
            self._controller.inputs.hold(names, self)
        self._send(frame(MessageType.SETUP_INPUTS, bytes([identifier]) + ",".join(kinds).encode()))

    def _data(self, payload: bytes, now: float) -> None:
        recipe = self._inputs.get(payload[0]) if payload else None
        if recipe is None or not recipe.apply(payload[1:], self._controller.inputs):
            self._controller.events["bad_input"] += 1
            self._log(
                f"RTDE input of recipe {payload[:1].hex()} with {len(payload)} bytes does not fit:"
                " ignored"
            )
            return
        self._controller.input_written(recipe.names, now)


def _names(payload: bytes) -> list[str]:
    return [name for name in payload.decode("ascii", "replace").split(",") if name]
