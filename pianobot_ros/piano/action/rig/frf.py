"""Transfer function by Welch's method: Hann window, overlapping sections, with coherence and the
variance of the estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import csd, get_window, welch

from pianobot_ros.cell.arrays import Array, ComplexArray
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.action.parameters import FrequencyResponseSettings

__all__ = ["FrequencyResponse", "section_length", "transfer_estimate"]


@dataclass(frozen=True)
class FrequencyResponse:
    """H1 estimate at ``frequency`` [Hz] (M,): ``response`` (M,) complex, ``coherence`` (M,) in 0 to
    1.

    ``hold`` [s] is how long the drive is held as a model sees it, ``averages`` the equivalent
    number of independent sections.
    """

    frequency: Array
    response: ComplexArray
    coherence: Array
    hold: float
    averages: float

    def band(self, low: float, high: float, every: int = 1) -> FrequencyResponse:
        """The part in ``low`` to ``high`` [Hz], keeping one bin in ``every``. Raises
        :class:`ConfigError` if empty.
        """
        keep = np.flatnonzero((self.frequency >= low) & (self.frequency <= high))[::every]
        if keep.size == 0:
            raise ConfigError(
                f"no frequency between {low} and {high} Hz in the estimate: record for longer"
            )
        return FrequencyResponse(
            self.frequency[keep],
            self.response[keep],
            self.coherence[keep],
            self.hold,
            self.averages,
        )


def section_length(samples: int, sections: int, overlap: float) -> int:
    """Length of each of ``sections`` sections of ``samples`` that overlap by the fraction
    ``overlap``.
    """
    length = int(samples / (1 + (sections - 1) * (1 - overlap)))
    if length < 16:
        raise ConfigError(
            f"{samples} samples are too few for {sections} sections: record for longer or average"
            " less"
        )
    return length


def transfer_estimate(
    drive: Array,
    response: Array,
    period: float,
    settings: FrequencyResponseSettings,
    *,
    hold: float | None = None,
) -> FrequencyResponse:
    """H1 = S_xy / S_xx of ``response`` over ``drive``, both (N,) at steps of ``period`` [s];
    ``hold`` defaults to it.
    """
    if drive.shape != response.shape or drive.ndim != 1:
        raise ConfigError(
            f"drive {drive.shape} and response {response.shape} must be vectors of one length"
        )
    length = section_length(drive.size, settings.sections, settings.overlap)
    shared = int(length * settings.overlap)
    options: dict[str, Any] = {
        "fs": 1.0 / period,
        "window": "hann",
        "nperseg": length,
        "noverlap": shared,
        "detrend": "constant",
    }
    frequency, cross = csd(drive, response, **options)
    _, power_in = welch(drive, **options)
    _, power_out = welch(response, **options)
    with np.errstate(divide="ignore", invalid="ignore"):
        estimate = cross / power_in
        coherence = np.clip(np.abs(cross) ** 2 / (power_in * power_out), 0.0, 1.0)
    keep = slice(1, None)  # the mean was removed, so 0 Hz says nothing
    averages = _independent_sections(length, shared, settings.sections)
    return FrequencyResponse(
        frequency[keep], estimate[keep], np.nan_to_num(coherence[keep]), hold or period, averages
    )


def _independent_sections(length: int, shared: int, sections: int) -> float:
    """Equivalent number of independent sections (Welch 1967): overlapping ones share samples."""
    window = get_window("hann", length)
    total = sections * np.sum(window**2) ** 2
    step = length - shared
    for lag in range(1, sections):
        if lag * step >= length:
            break
        common = np.sum(window[lag * step :] * window[: length - lag * step])
        total += 2 * (sections - lag) * common**2
    return float(sections**2 * np.sum(window**2) ** 2 / total)
