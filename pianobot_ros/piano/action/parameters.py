"""Parameters of the piano action, its rig and its extensions, from ``config/action.yaml``.

Everything is as seen at the key where the finger presses: x is the key's displacement, positive
downward; x_H the hammer's, positive toward the string and divided by the action's advantage, so
that x = x_H while the hammer rides on the key.
"""

from __future__ import annotations

from pianobot_ros.cell.numbers.config import Section, SpringDamper, load_section, quantity

__all__ = [
    "ActionParameters",
    "Armature",
    "BackRail",
    "Backcheck",
    "CoilCurve",
    "ExpectedTiming",
    "Felt",
    "FrequencyResponseSettings",
    "FrontRail",
    "Hammer",
    "InitialState",
    "Key",
    "LetOff",
    "Published",
    "RepetitionLever",
    "RigSettings",
    "String",
    "Support",
    "load_parameters",
]


class Armature(Section):
    """Voice-coil armature: the source impedance that stands in for a finger."""

    mass: float = quantity("kg", low=0.0)
    damping: float = quantity("N*s/m", low=0.0)
    stiffness: float = quantity("N/m", low=0.0)
    motor_constant: float = quantity("N/A", low=1e-6)


class Key(Section):
    """The key with its whippen; ``dip`` is where it meets the front rail; ``return_weight`` acts on
    a hinged key with let-off.
    """

    mass: float = quantity("kg", low=1e-6)
    damping: float = quantity("N*s/m", low=0.0)
    dip: float = quantity("m", low=1e-4, high=0.05)
    whippen_mass: float = quantity("kg", low=0.0)
    return_weight: float = quantity("N", low=0.0)


class Hammer(Section):
    """The hammer as seen at the key, and the viscoelastic coupler that carries it."""

    mass: float = quantity("kg", low=1e-6)
    coupler_damping: float = quantity("N*s/m", low=0.0)
    coupler_stiffness: float = quantity("N/m", low=1e-6)
    bushing_damping: float = quantity("N*s/m", low=0.0)
    advantage: float = quantity("1", low=1.0)
    weight: float = quantity("N", low=0.0)


class FrontRail(SpringDamper):
    """Felt under the front of the key."""


class InitialState(Section):
    """Where the step of Figs. 9 and 10 starts (not given in the paper)."""

    flexure_home: float = quantity("m")
    start: float = quantity("1", low=0.0, high=1.0)


class BackRail(SpringDamper):
    """Felt under the back of the key, where it rests."""


class String(SpringDamper):
    """The string as a unilateral spring and damper at ``height`` above the hammer at rest."""

    height: float = quantity("m", low=1e-4)


class LetOff(Section):
    """Escapement: the jack leaves the hammer ``margin`` before the string."""

    margin: float = quantity("m", low=0.0)
    ramp: float = quantity("m", low=1e-6)
    hysteresis: float = quantity("m", low=0.0)
    resistance: float = quantity("N", low=0.0)


class RepetitionLever(SpringDamper):
    """Sprung lever that carries the hammer while the jack is out."""

    drop: float = quantity("m", low=0.0)
    preload: float = quantity("N", low=0.0)


class Backcheck(SpringDamper):
    """Catches the returning hammer while the key is deep."""

    catch: float = quantity("m", low=0.0)
    reach: float = quantity("m", low=0.0)
    key_depth: float = quantity("m", low=0.0)
    release: float = quantity("m", low=0.0)


class Support(SpringDamper):
    """What carries the hammer once the jack is out: the whippen, and the hammer rest rail."""

    drop: float = quantity("m", low=0.0)
    rest_rail: float = quantity("m")
    rest_rail_single: float = quantity("m")


class RigSettings(Section):
    """The voice-coil rig's instruments and excitation."""

    encoder_resolution: float = quantity("1/m", low=1.0)
    command_rate: float = quantity("Hz", low=1.0)
    mean_period: float = quantity("s", low=1e-6)
    overrun_shape: float = quantity("1", low=0.1)
    duration: float = quantity("s", low=1.0)
    current_peak: float = quantity("A", low=0.0)
    load_cell_noise: float = quantity("N", low=0.0)
    rail_trial_bias: float = quantity("A")
    rail_trial_peak: float = quantity("A", low=0.0)
    rail_trial_duration: float = quantity("s", low=1.0)
    step_current: float = quantity("A")


class CoilCurve(Section):
    """How far the voice coil alone is from linear, before its compensation."""

    weight: float = quantity("N")
    quadratic: float = quantity("1")
    cubic: float = quantity("1")
    current_noise: float = quantity("A", low=0.0)


class Felt(Section):
    """Felt by Hunt and Crossley in the place of the linear springs and dampers."""

    power: float = quantity("1", low=1.0, high=5.0)
    force: float = quantity("N", low=0.1)


class FrequencyResponseSettings(Section):
    """Welch's method and the fitted band."""

    sections: int = quantity("1", low=2)
    overlap: float = quantity("1", low=0.0, high=0.9)
    fit_low: float = quantity("Hz", low=0.0)
    fit_high: float = quantity("Hz", low=0.0)


class Published(Section):
    """What the paper shows or says."""

    armature_cutoff: float = quantity("Hz")
    antiresonance: float = quantity("Hz")
    resonance: float = quantity("Hz")
    step_time: float = quantity("s")
    bottoming: float = quantity("s")
    landing: float = quantity("s")


class ExpectedTiming(Section):
    """Timing that a grand action should show."""

    key_to_hammer_fast: float = quantity("s")
    key_to_hammer_slow: float = quantity("s")
    bottom_before_contact_forte: float = quantity("s")
    bottom_after_contact_piano: float = quantity("s")


class ActionParameters(Section):
    """All of ``config/action.yaml``. Immutable; vary it with :meth:`vary`."""

    armature: Armature
    key: Key
    hammer: Hammer
    front_rail: FrontRail
    initial_state: InitialState
    back_rail: BackRail
    string: String
    let_off: LetOff
    repetition_lever: RepetitionLever
    backcheck: Backcheck
    support: Support
    rig: RigSettings
    curve: CoilCurve
    felt: Felt
    frequency_response: FrequencyResponseSettings
    published: Published
    expected: ExpectedTiming

    @property
    def moving_mass(self) -> float:
        """Mass of everything that moves with x [kg]: armature, key and whippen."""
        return self.armature.mass + self.key.mass + self.key.whippen_mass

    @property
    def moving_damping(self) -> float:
        """Damping to ground of everything that moves with x [N*s/m]."""
        return self.armature.damping + self.key.damping

    def vary(self, section: str, **values: float) -> ActionParameters:
        """A copy with some numbers of one ``section`` replaced, e.g. ``vary("hammer",
        weight=0.2)``.
        """
        old = getattr(self, section)
        new = type(old).model_validate({**old.model_dump(), **values})
        return self.model_copy(update={section: new})


def load_parameters(path: str = "action.yaml") -> ActionParameters:
    """Read ``config/action.yaml``. Raises :class:`~pianobot_ros.cell.errors.ConfigError` in one
    line.
    """
    return load_section(path, ActionParameters)
