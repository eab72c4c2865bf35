"""The live comparison of a strike."""

from __future__ import annotations

from types import SimpleNamespace

from pianobot_ros.cli.graph.comparison_table import strike_line


def test_a_line_says_units_and_which_number_is_the_real_cells() -> None:
    def stroke(shift: float) -> SimpleNamespace:
        numbers = {"v_pre": 0.1, "v_rel": 0.2, "t_hold": 0.3, "t_idle": 0.4, "peak_force": 5.0}
        return SimpleNamespace(**{name: x + shift for name, x in numbers.items()})

    gap = SimpleNamespace(real=stroke(0.0), sim=stroke(1.0), note=64, condition="soft", err=0.05)
    gap.real_missing = gap.sim_missing = False
    line = strike_line(SimpleNamespace(strike=3, keystrokes=[gap], latency=0.02))
    assert line == (
        "strike 3  note 64  condition soft  real | sim:  V_pre 0.100 | 1.100 m/s"
        "  V_rel 0.200 | 1.200 m/s  T_hold 0.300 | 1.300 s  T_idle 0.400 | 1.400 s"
        "  peak 5.00 | 6.00 N  Err 5.0 %  latency 20 ms"
    )
