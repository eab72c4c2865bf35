"""Reports: a diagnosis as one self-contained HTML file."""

from pianobot_ros.gap.report.render import render, write_report

__all__ = ["render", "write_report"]
