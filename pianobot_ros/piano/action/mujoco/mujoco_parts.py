"""Let-off, repetition lever and backcheck in MuJoCo: the parts of the action that remember,
switched between steps.

Every element of the exact model that MuJoCo does not have by itself becomes an actuator on the
fixed tendon along its direction. Its gain is the element's law, affine in length and velocity, so
that a command of 1 puts it in and 0 takes it out.
The coupler is the other way round: 1 lifts the hammer off the jack. A :class:`Switchboard` reads
the state before every step, fires the very rules of the exact model and writes the commands.
Without one (commands 0, as stock MuJoCo has them) the model is the action of the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array, IntArray
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.piano.action.hybrid.action_model import ActionModel
from pianobot_ros.piano.action.hybrid.elements import ONE, SIZE, Element, Mode

__all__ = ["ActionEvent", "Attachment", "Switchboard", "add_parts", "has_memory"]


LIMIT = 1e4  # N, far above any force in an action
_NATIVE = frozenset(
    {"coupler", "front_rail", "back_rail"}
)  # a clamped actuator and a joint's limits are these
_MOST = 32  # switches of one action in one step, beyond which it will not settle


@dataclass(frozen=True)
class Attachment:
    """Where an action sits: its ``name``, the joints of key and hammer, metres of key travel for
    one unit of the key's joint (``arm``), and the ``origin`` (m): what the exact model's x and x_H
    are where both joints are at 0.
    """

    name: str
    key_joint: str
    hammer_joint: str
    arm: float = 1.0
    origin: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class ActionEvent:
    """A rule of the exact model that fired at ``time`` [s] in the action ``name``;
    ``hammer_velocity`` [m/s] seen at the key.
    """

    time: float
    name: str
    rule: str
    hammer_velocity: float


def has_memory(action: ActionModel) -> bool:
    """Whether ``action`` has parts that a :class:`Switchboard` must switch."""
    return not set(action.elements) <= _NATIVE


def _pushes_only(action: ActionModel, element: Element) -> bool:
    """Whether the element's contact breaks as soon as it would pull."""
    return any(
        element.name in rule.removes and any(np.array_equal(g, -element.force) for g in rule.guards)
        for rule in action.rules
    )


def add_parts(spec: mujoco.MjSpec, action: ActionModel, at: Attachment) -> None:
    """Add tendon and actuator ``<name>_<element>`` for every element of ``action`` that MuJoCo has
    not by itself.

    The coupler must be there (actuator ``<name>_coupler``); it learns to let go. Joints and hammer
    must be there too.
    """
    for element in action.elements.values():
        if element.name in _NATIVE:
            continue
        dx, dh = element.direction
        tendon = spec.add_tendon(name=f"{at.name}_{element.name}")
        if dx:
            tendon.wrap_joint(at.key_joint, dx * at.arm)
        if dh:
            tendon.wrap_joint(at.hammer_joint, dh)
        offset = dx * at.origin[0] + dh * at.origin[1] - element.offset
        law = _actuator(spec, f"{at.name}_{element.name}", tendon.name)
        law.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
        law.gainprm[:3] = (
            -(element.preload + element.stiffness * offset),
            -element.stiffness,
            -element.damping,
        )
        if _pushes_only(action, element):
            law.forcelimited = True
            law.forcerange = (-LIMIT, 0.0)
        if element.remembers:  # the command is what it remembers
            memory = _actuator(spec, f"{at.name}_{element.name}_memory", tendon.name)
            memory.gaintype = mujoco.mjtGain.mjGAIN_FIXED
            memory.gainprm[0] = element.stiffness
    spec.actuator(f"{at.name}_coupler").gainprm[0] = LIMIT


def _actuator(spec: mujoco.MjSpec, name: str, tendon: str) -> mujoco.MjsActuator:
    actuator = spec.add_actuator(name=name, target=tendon, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    actuator.biastype = mujoco.mjtBias.mjBIAS_NONE
    return actuator


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _switch(
    state: Array,
    modes: IntArray,
    guards: Array,
    first: IntArray,
    needs: IntArray,
    bars: IntArray,
    adds: IntArray,
    removes: IntArray,
    memory: Array,
    remembers: IntArray,
    fired: IntArray,
) -> int:
    """Fire the rules of every action until none is open. ``state`` (n, SIZE), ``modes`` (n,) bits,
    ``fired`` (m, 2) gets action and rule. Returns how many fired, or -1 if switching does not end.
    """
    count = 0
    for k in range(state.shape[0]):
        for turn in range(_MOST + 1):
            chosen = -1
            for r in range(needs.size):
                if (modes[k] & needs[r]) != needs[r] or (modes[k] & bars[r]) != 0:
                    continue
                is_open = True
                for g in range(first[r], first[r + 1]):
                    value = 0.0
                    for i in range(guards.shape[1]):
                        value += guards[g, i] * state[k, i]
                    if value <= 1e-10:
                        is_open = False
                        break
                if is_open:
                    chosen = r
                    break
            if chosen < 0:
                break
            if turn == _MOST or count == fired.shape[0]:
                return -1
            if remembers[chosen]:
                value = 0.0
                for i in range(memory.shape[1]):
                    value += memory[chosen, i] * state[k, i]
                state[k, 4] = value
            modes[k] = (modes[k] & ~removes[chosen]) | adds[chosen]
            fired[count, 0], fired[count, 1] = k, chosen
            count += 1
    return count


class Switchboard:
    """Switches the actions of a compiled ``model``, which all have the parts of ``action``. Call
    :meth:`update` before a step.

    Attributes: ``events`` that fired since the last :meth:`reset`.
    """

    def __init__(
        self, model: mujoco.MjModel, action: ActionModel, places: Sequence[Attachment]
    ) -> None:
        self.action, self.places = action, tuple(places)
        self.events: list[ActionEvent] = []
        self._step = float(model.opt.timestep)
        names = sorted({"jack"} | set(action.elements))
        self._bit = {name: 1 << i for i, name in enumerate(names)}
        joints = [(model.joint(p.key_joint), model.joint(p.hammer_joint)) for p in self.places]
        self._qpos = np.array([[j.qposadr[0] for j in pair] for pair in joints])
        self._dof = np.array([[j.dofadr[0] for j in pair] for pair in joints])
        self._scale = np.array([[p.arm, 1.0] for p in self.places])
        self._origin = np.array([p.origin for p in self.places])
        rules = action.rules
        self._guards = np.array([g for r in rules for g in r.guards]).reshape(-1, SIZE)
        self._first = np.concatenate([[0], np.cumsum([len(r.guards) for r in rules])]).astype(
            np.int64
        )
        self._needs, self._bars, self._adds, self._removes = (
            np.array([self._bits(getattr(r, field)) for r in rules], dtype=np.int64)
            for field in ("needs", "bars", "adds", "removes")
        )
        self._memory = np.array(
            [np.zeros(SIZE) if r.remembers is None else r.remembers for r in rules]
        )
        self._remembers = np.array([r.remembers is not None for r in rules], dtype=np.int64)
        self._fired = np.empty((_MOST * len(self.places), 2), dtype=np.int64)
        switched = [e for e in action.elements.values() if e.name not in _NATIVE]
        self._on = np.array([self._bit[e.name] for e in switched], dtype=np.int64)
        self._control = np.array(
            [[model.actuator(f"{p.name}_{e.name}").id for e in switched] for p in self.places],
            dtype=np.intp,
        ).reshape(len(self.places), -1)
        self._coupler = np.array([model.actuator(f"{p.name}_coupler").id for p in self.places])
        held = next((e.name for e in switched if e.remembers), None)
        self._held = self._bit[held] if held else 0
        self._recall = np.array(
            [model.actuator(f"{p.name}_{held}_memory").id for p in self.places] if held else []
        )
        self.reset()

    def _bits(self, mode: Mode) -> int:
        # carriers that this action does not have never are in a mode
        return sum(self._bit.get(name, 0) for name in mode)

    def reset(self) -> None:
        """All actions at rest, jacks in."""
        self.events.clear()
        mode, z = self.action.rest()
        self._modes = np.full(len(self.places), self._bits(mode), dtype=np.int64)
        self._state = np.tile(z, (len(self.places), 1))

    def modes(self) -> list[Mode]:
        """What is active in each action, as in the exact model."""
        return [
            frozenset(n for n, bit in self._bit.items() if mode & bit)
            for mode in self._modes.tolist()
        ]

    def update(self, data: mujoco.MjData) -> None:
        """Fire what is due in the middle of the coming step, and command it. Raises PianobotError
        if switching never ends.
        """
        z = self._state
        speed = data.qvel[self._dof] * self._scale
        z[:, 0:3:2] = data.qpos[self._qpos] * self._scale + self._origin + 0.5 * self._step * speed
        z[:, 1:4:2] = speed
        z[:, ONE] = 1.0
        count = _switch(
            z,
            self._modes,
            self._guards,
            self._first,
            self._needs,
            self._bars,
            self._adds,
            self._removes,
            self._memory,
            self._remembers,
            self._fired,
        )
        if count < 0:
            raise PianobotError(
                f"the action keeps switching at {data.time:.4f} s: take a smaller step"
            )
        for k, r in self._fired[:count].tolist():
            self.events.append(
                ActionEvent(
                    float(data.time), self.places[k].name, self.action.rules[r].name, float(z[k, 3])
                )
            )
        data.ctrl[self._control] = (self._modes[:, None] & self._on) != 0
        data.ctrl[self._coupler] = (self._modes & self._bit["jack"]) == 0
        if self._held:
            data.ctrl[self._recall] = np.where(self._modes & self._held, z[:, 4], 0.0)
