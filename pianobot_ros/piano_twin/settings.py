"""How the engine is set for the piano cell."""

from __future__ import annotations

from functools import cache

from pianobot_ros.cell.config import config_dir, load_yaml
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.gap import Calibration, Options

__all__ = ["CALIBRATION", "options", "prior_options"]

CALIBRATION = "calibration/diagnosis.yaml"
"""What ``benchmarks/calibrate.py`` learned, in the configuration's directory."""


def prior_options() -> Options:
    """The settings before anything is learned.

    The cell's twin is right to a few thousandths of a signal, so what an effect leaves open says
    more than elsewhere. Its force has ten thousand samples, and in a cell without any effect
    hypotheses still differ by a hundred nats.
    """
    return Options(calibration=Calibration(temperature=15.0, unknown_near=0.3))


@cache
def options() -> Options:
    """The settings, with the learned constants where there are any. Raises :class:`ConfigError` for
    a file that does not hold them.
    """
    path = config_dir() / CALIBRATION
    if not path.is_file():
        return prior_options()
    data = load_yaml(path)
    try:
        learned = Calibration(
            temperature=float(data["temperature"]),
            event_temperature=float(data["event_temperature"]),
            levels={str(k): float(v) for k, v in data["levels"].items()},
            unknown_near=prior_options().calibration.unknown_near,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"{CALIBRATION} is not what calibrate.py writes: {error}") from error
    return Options(calibration=learned)
