"""The parts of the action as elements and switching rules: Table 3 of the paper, and what the paper
leaves for later.
"""

from __future__ import annotations

from pianobot_ros.piano.action.hybrid.elements import HAMMER, KEY, ONE, Element, Mode, Rule, row
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = [
    "LEVER",
    "after_let_off_part",
    "back_rail_part",
    "contact",
    "let_off_part",
    "position_contact",
    "string_part",
    "table_three_rules",
]

LEVER: Mode = frozenset({"lever", "lever_yields", "lever_screw", "lever_screw_yields"})
_NAMES = {"front_rail": ("bottom", "lift")}


def table_three_rules(coupler: Element) -> list[Rule]:
    """Transitions a, b, e and f of Table 3: the coupler is made and broken on its own force."""
    c = frozenset({"coupler"})
    return [
        Rule("release", (-coupler.force,), needs=c, removes=c),
        Rule("land", (coupler.force,), needs=frozenset({"jack"}), bars=c, adds=c),
    ]


def position_contact(element: Element) -> list[Rule]:
    """Transitions c, d, g and h of Table 3: the rail is made and broken on position."""
    own = frozenset({element.name})
    return [
        Rule("bottom", (element.stretch,), bars=own, adds=own),
        Rule("lift", (-element.stretch,), needs=own, removes=own),
    ]


def contact(element: Element, needs: Mode = frozenset(), bars: Mode = frozenset()) -> list[Rule]:
    """A contact that can only push: made when it is closed and would push, broken when it would
    pull.
    """
    own = frozenset({element.name})
    made, broken = _NAMES.get(element.name, (f"{element.name} made", f"{element.name} broken"))
    return [
        Rule(made, (element.stretch, element.force), needs=needs, bars=bars | own, adds=own),
        Rule(broken, (-element.force,), needs=own, removes=own),
    ]


def back_rail_part(p: ActionParameters) -> tuple[list[Element], list[Rule]]:
    """The felt on which the key rests."""
    rail = Element("back_rail", (-1.0, 0.0), 0.0, p.back_rail.stiffness, p.back_rail.damping)
    return [rail], contact(rail)


def string_part(p: ActionParameters) -> tuple[list[Element], list[Rule]]:
    """The string, which the hammer meets."""
    string = Element("string", (0.0, 1.0), p.string.height, p.string.stiffness, p.string.damping)
    return [string], contact(string)


def let_off_part(p: ActionParameters) -> tuple[list[Element], list[Rule]]:
    """The jack meets the let-off button over a ramp, and is out at its end; past it the key bears a
    constant resistance.
    """
    escape, ramp = p.string.height - p.let_off.margin, p.let_off.ramp
    resistance = p.let_off.resistance
    on = Element("let_off", (1.0, 0.0), escape - ramp, resistance / ramp)
    hold = Element("let_off_hold", (1.0, 0.0), escape, preload=resistance)
    a, b = frozenset({"let_off"}), frozenset({"let_off_hold"})
    past = row({KEY: 1.0, ONE: -escape})
    return [on, hold], [
        Rule("let-off begins", (on.stretch, -past), bars=a | b, adds=a),
        Rule("let-off ends", (-on.stretch,), needs=a, removes=a),
        # From the ramp, or at once where a motion begins beyond it.
        Rule("let-off full", (past,), bars=b, removes=a, adds=b),
        Rule("let-off eases", (-past,), needs=b, removes=b, adds=a),
    ]


def after_let_off_part(
    p: ActionParameters, parts: frozenset[str] | set[str], coupler: Element
) -> tuple[list[Element], list[Rule]]:
    """Escapement and reset of the jack, and what carries the hammer in between.

    With a repetition lever that is the lever, and below it the whippen; without, only the check and
    the hammer rest rail: the jack stands beside the knuckle and cannot lift it.
    """
    jack = frozenset({"jack"})
    lever = "repetition_lever" in parts
    escape = p.string.height - p.let_off.margin
    past = row({KEY: 1.0, ONE: -escape})
    back = row({KEY: -1.0, ONE: escape - p.let_off.hysteresis})
    seat = p.support.rest_rail if lever else p.support.rest_rail_single
    whippen = Element(
        "support", (1.0, -1.0), p.support.drop, p.support.stiffness, p.support.damping
    )
    rest = Element("rest_rail", (0.0, -1.0), -seat, p.support.stiffness, p.support.damping)
    elements = [rest]
    rules = contact(rest)
    if lever:
        more, switching = _lever(p, coupler, escape)
        elements += [whippen, *more]
        rules += [*contact(whippen, bars=jack), *switching]
        yields = p.repetition_lever.preload / coupler.stiffness
        # The lever stands level with the jack, so the jack slips back as soon as the lever is up,
        # under load or not.
        up = row({KEY: -1.0, HAMMER: 1.0, ONE: yields})
        loaded = frozenset({"lever"})
        rules += [
            Rule(
                "jack back, loaded",
                (back, up),
                loaded,
                jack | {"check"},
                jack | {"coupler"},
                LEVER | {"support"},
            )
        ]
    else:
        up = -coupler.stretch  # only a hammer that rides above the jack lets it slip back
    rules += [
        Rule("jack out", (past,), jack, removes=jack | {"coupler"}),
        Rule(
            "jack back",
            (back, up),
            bars=jack | {"check", "lever"},
            adds=jack,
            removes=LEVER | {"support"},
        ),
    ]
    if "backcheck" in parts:
        more, switching = _backcheck(p, coupler)
        elements += more
        rules += switching
    return elements, rules


def _lever(
    p: ActionParameters, coupler: Element, escape: float
) -> tuple[list[Element], list[Rule]]:
    """Repetition lever: felt against the knuckle, a sprung lever that yields beyond its preload,
    and the drop screw.

    Up to the drop screw it moves with the key; beyond, the screw stops it, so that it cannot press
    the hammer on the string.
    """
    r = p.repetition_lever
    drop = escape - r.drop
    yields = r.preload / coupler.stiffness
    low = Element("lever", (1.0, -1.0), 0.0, coupler.stiffness, coupler.damping)
    low_soft = Element("lever_yields", (1.0, -1.0), yields, r.stiffness, r.damping, r.preload)
    high = Element("lever_screw", (0.0, -1.0), -drop, coupler.stiffness, coupler.damping)
    high_soft = Element(
        "lever_screw_yields", (0.0, -1.0), yields - drop, r.stiffness, r.damping, r.preload
    )
    above = row({KEY: 1.0, ONE: -drop})
    rules: list[Rule] = []
    for felt, spring, side in ((low, low_soft, -above), (high, high_soft, above)):
        own, soft = frozenset({felt.name}), frozenset({spring.name})
        rules += [
            Rule(
                f"{felt.name} made",
                (felt.stretch, felt.force, side),
                bars=LEVER | {"jack"},
                adds=own,
            ),
            Rule(f"{felt.name} broken", (-felt.force,), needs=own, removes=own),
            Rule(f"{felt.name} gives", (spring.stretch,), needs=own, removes=own, adds=soft),
            Rule(f"{felt.name} recovers", (-spring.stretch,), needs=soft, removes=soft, adds=own),
        ]
    for below, over in ((low, high), (low_soft, high_soft)):
        a, b = frozenset({below.name}), frozenset({over.name})
        rules += [
            Rule(f"{below.name} meets drop screw", (above,), needs=a, removes=a, adds=b),
            Rule(f"{below.name} leaves drop screw", (-above,), needs=b, removes=b, adds=a),
        ]
    return [low, low_soft, high, high_soft], rules


def _backcheck(p: ActionParameters, coupler: Element) -> tuple[list[Element], list[Rule]]:
    """Wedges the falling hammer where it meets the check, for as long as the key stays deep."""
    c = p.backcheck
    own = frozenset({"check"})
    check = Element("check", (1.0, -1.0), 0.0, c.stiffness, c.damping, remembers=True)
    height = p.key.dip - p.string.height + c.catch
    caught = row({KEY: 1.0, HAMMER: -1.0, ONE: -height})
    within = row({KEY: -1.0, HAMMER: 1.0, ONE: height + c.reach})
    deep = row({KEY: 1.0, ONE: -c.key_depth})
    eased = row({KEY: -1.0, ONE: c.release})
    return [check], [
        Rule(
            "hammer checked",
            (caught, within, deep, coupler.rate),
            bars=own | {"jack"},
            adds=own,
            remembers=coupler.stretch,
        ),
        Rule("check releases", (eased,), needs=own, removes=own),
    ]
