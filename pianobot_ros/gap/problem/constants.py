"""Every constant that decides something and is neither an option nor of a `Calibration` (see
`options.py`), room by room.

Each says where it comes from: *numerical* (any value about it gives the same answer, it only bounds
cost or guards a division), a *prior* (what is believed before the data speak), a reference, or
*development cells* (set there once, docs/diagnosis-method.md).
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri, ndtri

# -- arithmetic: what follows from a definition ----------------------------------------------------

TINY = float(np.finfo(float).tiny / np.finfo(float).eps)
"""What a divisor is at least, where it may be nothing; with room for what is divided by it."""
OF_MEDIAN = float(1.0 / ndtri(0.75))
"""Standard deviation of a Gaussian in units of the median of its distances from the middle."""

# -- words: what "most" and "small" mean, wherever it is asked -------------------------------------

MOST = 0.5
"""Share from which a part is most of a whole: of a power, of the variance of repeats, of what
refitting leaves, of what the best hypothesis gains or of its probability (what the word means)."""
SMALL = 0.1
"""Share or chance below which one thing is small beside another, and is left alone; and a
derivative's step, in prior standard deviations (prior: an order of magnitude)."""
NEGLIGIBLE = 0.01
"""Share below which a thing is not reckoned at all (numerical): so few of a sound robot's events
stray, too."""
RARE = 0.3
"""Largest share of events, or of samples, that may be unlike the others: their median is then none
of them (numerical); and of the weight that effects which may not be named hold together (prior)."""
ROUNDING = 1e-6
"""Share of a range, or of a size, that rounding may make, of single precision too: a value that is
no further from a bound is on it (numerical)."""
LEVEL = 0.95
"""Mass of an interval, and of a credible set that was never calibrated (what is promised)."""
UPPER = 0.5 * (1.0 + LEVEL)
"""What lies below the upper end of such an interval (derived)."""
FAR = 3.0
"""Prior standard deviations that nothing usual is away by, neither a parameter from where it is
believed nor a step from where its line was drawn (of a Gaussian one in 400 is; prior)."""
LEADERS = 3
"""So many of anything are looked at closer at each turn, or listed: hypotheses are fitted until
they converge, tried beside a leader, or from the nominal parameters; effects of a stage,
lines of a disturbance, names in a sentence (numerical)."""
SAMPLES = 1500
"""Most samples of a series that a trace draws, a regression looks at, or an experiment is judged
by (numerical: cost)."""
DRAWS = 1000
"""Bootstrap draws (Efron and Tibshirani 1993: some hundreds to a thousand for a quantile)."""

# -- recordings: what is no measurement ------------------------------------------------------------

LARGEST = 1e30
"""No quantity in any unit is larger: such a number is a glitch, and its square might overflow
(numerical).
"""
FEWEST_SAMPLES = 3
"""Samples below which a signal has no course (numerical)."""
CLOCK_STEP = 10.0
"""Sample intervals by which a stamp may lie before the one before it: more is a clock that was set
(prior: buffers are shorter).
"""
DISAGREE = 0.7
"""Share of the larger of two one-sided differences by which they disagree (numerical)."""
MISSED = 5.0
"""Floors at least by which an event that only one side has counts (prior)."""

# -- floor: what is scatter, and what is not -------------------------------------------------------

CHANCE = 1e-3
"""Probability that chance alone makes repeats seem to follow from what came before, from the
session's time or from a clock of its own (level of a test).
"""
EARLY = 0.3
"""Share of the session after which most of a drift that settles is over (prior)."""
LASTING, SIZES = (0.0125, 0.025, 0.05, 0.1), (0.0, 0.25, 1.0, 4.0, 16.0)
"""How long a wander of repeats may last, as a share of the session: longer ones are a course of it
(prior). Its variance in that of white scatter (numerical)."""
LOBE, ABOUT, FINER = 2.0, 10.0, 4
"""Of a line whose phase is another in each block, in resolutions: how far it reaches to either side
by a Hann window (Harris 1978, Proceedings of the IEEE 66, 51), twice of which it must be from 0, so
that it does not reach its own image; how far the spectrum about it is looked at; and frequencies
looked at in each of these (numerical)."""
BURST = 0.5 * float(chdtrc(1, chdtri(3, 0.5)))
"""Share of the time in which half of a residual's power lies, below which it comes in bursts: half
of what any Gaussian process takes, however correlated (chi-square with one degree of freedom)."""
STRAY = 9.0
"""Robust standard deviations from which a repeat is a stray: a Gaussian never is
(prior).
"""
PIECES = 12
"""Pieces of a block whose power is compared, where nothing repeats (numerical)."""

# -- fitting ---------------------------------------------------------------------------------------

HUBER = 4.0
"""Robust standard deviations from which a sample pulls no harder (Huber 1964; 1.345 is usual
for noise, misfit has longer tails)."""
DIFFERENCES = (0.5, 0.05)
"""Steps of derivatives, in prior standard deviations, where a fit gets no further. Contacts that
open and close make a prediction rough; over a step that hardly moves it, that is all of the
difference, and the parameter seems to do nothing (Moré and Wild 2012, ACM Transactions on
Mathematical Software 38). Over a long one it is bent (numerical)."""
FAITHFUL = 0.25
"""Share of a step's gain by which it may miss what the Jacobian promised before that is computed
anew: from 0.75 on a model of the cost counts as good (Nocedal and Wright 2006, chapter 4)."""
EXACT_TRIES = 5
"""Dampings tried with a fresh Jacobian: contacts that open and close make the valley's floor rough,
so steps must be short (numerical).
"""

# -- search: what is looked at closer --------------------------------------------------------------

HEAT = 3
"""Steps after which the shortlisted effects are compared first (racing; Maron and Moore 1994)."""
MUCH = 0.2
"""Share of the squared gap that refitting leaves from which the best hypothesis leaves much: others
are looked for from the nominal parameters, too (development cells)."""

# -- posterior -------------------------------------------------------------------------------------

KNOTS = 5
"""Knots of a course over an attribute or the session: some dozens of events carry no more
(prior)."""
SHRINKAGE = (0.1, 1.0, 10.0, 100.0)
"""Prior precisions that are tried, in units of one floor; the one that predicts best is taken
(numerical)."""

# -- what is said ----------------------------------------------------------------------------------

RUN_AWAY = 1e6
"""Floors; predictions that are further apart have run away, no matter how far (numerical)."""
INDEPENDENT = 8.0
"""Independent samples of a series and block, about (development cells)."""
ENOUGH = next(n for n in range(1, 100) if n**-n < 1.0 - UPPER)
"""So many of anything are drawn by a bootstrap, are left out, or have a spread: conditions and not
blocks (repeats of one share what is wrong there, as the rounding of a velocity is), blocks and not
pieces of them. Of fewer the end of an interval would be one of them alone, drawn every time
(derived)."""
