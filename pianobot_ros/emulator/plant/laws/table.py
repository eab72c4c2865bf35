"""The laws of every effect, with their sources.

``python -m pianobot_ros.emulator.plant.laws.table`` prints them as the table of docs/plant.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

__all__ = ["HELD_BACK", "LAWS", "LAW_COUNT", "Law", "law_count", "to_markdown"]


class Law(NamedTuple):
    """A law in a few words, and where it comes from."""

    text: str
    source: str


LAWS: Mapping[str, tuple[Law, Law, Law, Law]] = {
    "wrist_delay": (
        Law("queue, each wait 0.8 to 1.2 of the mean", "Nilsson 1998, real-time control"),
        Law("constant", "transport delay, Åström and Murray 2008"),
        Law("polled every twice the mean", "Törngren 1998"),
        Law("a fixed part and an exponential wait in a queue", "Kleinrock 1975"),
    ),
    "wrist_lag": (
        Law("two stages, slower with the error", "assumed"),
        Law("first order", "Åström and Murray 2008"),
        Law("rate-limited beyond 1 mm", "Åström and Murray 2008"),
        Law("second-order low pass, damping ratio 0.7", "Butterworth 1930"),
    ),
    "wrist_compliance": (
        Law("9 Hz mass, spring, light damper", "two-mass system, Den Hartog 1956"),
        Law("spring and damper side by side, 20 ms", "Kelvin and Voigt"),
        Law("transmission that stiffens with load", "Tuttle and Seering 1996"),
        Law("springs in an arm's joints: what pushes up also pushes forward", "Salisbury 1980"),
    ),
    "pressure_lag": (
        Law("nozzle, choked below the critical ratio", "ISO 6358"),
        Law("first order", "linear restriction, Beater 2007"),
        Law("two equal volumes", "Richer and Hurmuzlu 2000"),
        Law(
            "first order, 2.5 times faster when air comes in",
            "charging and discharging, Andersen 1967",
        ),
    ),
    "pressure_leak": (
        Law("root of the pressure", "orifice, Beater 2007"),
        Law("in proportion to the pressure", "Hagen and Poiseuille"),
        Law("past a seal that lifts at 30 kPa", "Beater 2007"),
        Law("hole to the outside, choked below the critical ratio", "ISO 6358"),
    ),
    "regulator_hysteresis": (
        Law("Bouc-Wen", "Wen 1976"),
        Law("play", "Krasnosel'skii and Pokrovskii 1989"),
        Law("two plays of different widths", "Prandtl and Ishlinskii, Kuhnen 2003"),
        Law(
            "relays of four widths, right at both ends of the range",
            "Preisach 1935, Mayergoyz 1991",
        ),
    ),
    "joint_friction": (
        Law("LuGre bristles", "Canudas de Wit and others 1995"),
        Law("regularised Stribeck with stiction", "Andersson, Söderberg, Björklund 2007"),
        Law("Bouc-Wen", "Wen 1976"),
        Law(
            "three springs that slip one after the other",
            "generalised Maxwell slip, Al-Bender, Lampaert, Swevers 2005",
        ),
    ),
    "joint_backlash": (
        Law("rounded gap, weak guide, damped flanks", "Nordin and Gutman 2002"),
        Law("sharp dead zone", "Nordin and Gutman 2002"),
        Law("flanks that grow stiff", "Greenwood and Williamson 1966"),
        Law(
            "shaft with play: spring and damper relax in it, flanks never pull",
            "Nordin, Galic, Gutman 1997",
        ),
    ),
    "joint_hardening": (
        Law("exponential", "Fung 1967"),
        Law("cubic", "Duffing 1918"),
        Law("second spring from 0.015 rad on", "Shaw and Holmes 1983"),
        Law("bones that meet when bent back, power 1.5", "Hertz 1882"),
    ),
    "jamming_hysteresis": (
        Law("three yielding elements; stiffness remembers pressure", "Iwan 1966"),
        Law("one Dahl element, no memory of pressure", "Dahl 1968"),
        Law("one element that yields early; a longer memory of pressure", "Iwan 1966"),
        Law(
            "hyperbola that starts anew after each reversal, no memory of pressure",
            "soil, Kondner 1963, Pyke 1979",
        ),
    ),
    "joint_creep": (
        Law("three Kelvin branches", "Kelvin and Voigt"),
        Law("one branch of 0.3 s", "standard linear solid, Zener 1948"),
        Law("power of time by branches of 0.01 to 4 s", "Schapery 1969"),
        Law("dashpot that gives way as a hyperbolic sine", "Halsey, White, Eyring 1945"),
    ),
    "pad_compliance": (
        Law("skin, force to the power 2/3", "Hertz 1882"),
        Law("linear layer", "Johnson 1985"),
        Law("pulp that fills out exponentially", "Serina, Mote, Rempel 1997"),
        Law(
            "layer whose force goes with the square of its depth",
            "soft fingers, Xydas and Kao 1999",
        ),
    ),
    "tip_slip": (
        Law("friction weakens with sliding speed", "Rice and Ruina 1983"),
        Law("less friction, at any speed", "Amontons"),
        Law("friction falls as a Gaussian of the speed", "Armstrong-Hélouvry and others 1994"),
        Law("friction coefficient falls with the load", "rubber, Schallamach 1952"),
    ),
    "tip_offset": (
        Law("pad across the last phalanx", "geometry"),
        Law("pad along the last phalanx", "geometry"),
        Law("pad too thick all around", "geometry"),
        Law("pad across and along the last phalanx, at 45 degrees", "geometry"),
    ),
    "key_friction": (
        Law("LuGre bristles", "Canudas de Wit and others 1995"),
        Law("regularised Stribeck with stiction", "Andersson, Söderberg, Björklund 2007"),
        Law("Bouc-Wen", "Wen 1976"),
        Law("Dahl", "Dahl 1968"),
    ),
    "key_preload": (
        Law("felt under tension and a magnet", "assumed"),
        Law("constant torque", "wound spring"),
        Law("magnet at rest alone", "Coulomb's law of poles"),
        Law("spring wound by 0.09 rad, and further by the key", "Wahl 1963"),
    ),
    "hammer": (
        Law("mass on a coupler, flies, is caught", "Hirschkorn, McPhee, Birkett 2006"),
        Law("mass on a felt knuckle, no escapement", "Hirschkorn, McPhee, Birkett 2006"),
        Law("mass hung on a spring of 30 Hz", "Den Hartog 1956"),
        Law(
            "weighted lever in a slot with play, both ways",
            "two inertias with backlash, Nordin and Gutman 2002",
        ),
    ),
    "let_off": (
        Law("skewed bump, weaker on the way back", "Askenfelt and Jansson 1990"),
        Law("raised cosine, the same both ways", "Askenfelt and Jansson 1990"),
        Law("friction of a click over 0.01 rad", "Coulomb"),
        Law("triangle, on the way down only", "Askenfelt and Jansson 1990"),
    ),
    "felt_nonlinear": (
        Law("power 2.5 with loss", "Hunt and Crossley 1975"),
        Law("power 1.5 without loss", "Hertz 1882"),
        Law("power 2.5 with fading memory", "Stulov 1995"),
        Law("wool that is pressed to half, without loss", "van Wyk 1946"),
    ),
    "midi_velocity_curve": (
        Law("logistic", "assumed"),
        Law("power 0.6", "Goebl and Bresin 2003"),
        Law("two straight pieces", "table of three points"),
        Law("logarithm", "Goebl and Bresin 2003"),
    ),
    "midi_latency": (
        Law("shorter for loud notes, then the next 1 ms frame", "USB 2.0"),
        Law("constant", "transport delay"),
        Law("half of it constant, then polled every mean", "Törngren 1998"),
        Law("constant, and a sawtooth of 5 s", "two clocks that run apart"),
    ),
    "midi_jitter": (
        Law("gamma-distributed", "Kleinrock 1975"),
        Law("even up to twice the mean", "behind a poll, Törngren 1998"),
        Law("a quarter of the notes waits four times the mean", "full buffer, Kleinrock 1975"),
        Law("normal, cut off at none", "many small waits, Laplace 1812"),
    ),
    "trigger_offset": (
        Law("both low, off by 0.6 of it", "geometry"),
        Law("both low by the same", "geometry"),
        Law("both low, off by 1.3 of it", "geometry"),
        Law("only the contact for note-on low", "geometry"),
    ),
    "fsr_hysteresis": (
        Law("Bouc-Wen", "Wen 1976"),
        Law("exponential loop", "Duhem, Dahl 1968"),
        Law("three plays in parallel", "Prandtl and Ishlinskii, Kuhnen 2003"),
        Law("other gain on the way down, right at both ends", "Interlink, FSR integration guide"),
    ),
    "fsr_creep": (
        Law("logarithm of the time under load", "Interlink, FSR integration guide"),
        Law("one branch of 0.4 s", "standard linear solid, Zener 1948"),
        Law("power 0.3 of the time under load", "Nutting 1921"),
        Law("branches of 0.08 and 1 s", "Prony series, Findley, Lai, Onaran 1976"),
    ),
    "fsr_saturation": (
        Law("p = 4 norm of line and ceiling", "assumed"),
        Law("hyperbola of a divider", "Interlink, FSR integration guide"),
        Law("cubic term", "first terms of any odd soft limit"),
        Law("hyperbolic tangent", "soft limit, Åström and Murray 2008"),
    ),
    "clock_skew": (
        Law("rate error that wanders by a fifth", "Allan 1966"),
        Law("constant rate error", "Mills 1991"),
        Law("rate error that grows over 30 s", "crystal warming up, Vig 1992"),
        Law("rate error that grows evenly, doubled in a minute", "quadratic clock, Allan 1987"),
    ),
}
"""Laws 0 to 3 by effect; an effect that is not here has one law. Law 3 is held back: nothing may be
calibrated on it or developed with it (docs/plant.md).
"""

LAW_COUNT = 4
"""Laws of an effect of the library."""

HELD_BACK = 3
"""The law that is kept for blind checks."""


def law_count(name: str) -> int:
    """How many laws the effect ``name`` has."""
    return len(LAWS.get(name, (None,)))


def to_markdown() -> str:
    """The table of docs/plant.md."""
    lines = ["| family | law 0 | law 1 | law 2 | law 3 |", "| -- | -- | -- | -- | -- |"]
    for name, laws in LAWS.items():
        cells = " | ".join(f"{law.text} ({law.source})" for law in laws)
        lines.append(f"| `{name}` | {cells} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(to_markdown(), end="")
