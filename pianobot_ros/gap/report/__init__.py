"""Reports: a diagnosis as one self-contained HTML file and as diagnosis.json."""

from pianobot_ros.gap.report.render import render, write_json, write_report

__all__ = ["render", "write_json", "write_report"]
