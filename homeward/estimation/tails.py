"""Tails of estimates: heavier than those of the filter's normal distributions.

The filter is overconfident in the tails: margins are below its 0.1 % quantile in up to 19 of a
thousand missions (docs/results.md). Probabilities are therefore those of Student's t at the same
number of standard deviations: a risk of one in a thousand corresponds to the normal quantile at one
in a million, to which the shield was tuned.
"""

from __future__ import annotations

from scipy.special import ndtri, stdtrit

from homeward.estimation import thresholds


def deviations(share: float) -> float:
    """Standard deviations of a quantile: a share of Student's t is below.

    >>> round(deviations(0.95), 2)
    1.89
    """
    return float(stdtrit(thresholds.DEGREES, share))


def scale_of(sd: float) -> float:
    """Scale with which Student's t has the same central 90 % interval as a normal distribution of a
    given deviation.

    For measured spreads, such as that between runs: the interval is as wide, and the tails are
    heavier.

    >>> round(scale_of(1.0) * deviations(0.95), 3)
    1.645
    """
    return sd * float(ndtri(0.95)) / deviations(0.95)
