"""Tails of what is estimated: heavier than those of the normal distributions that a filter reckons with.

A filter of twelve numbers and a wind is surer in the tails than it should be: margins fall below its quantile at one in
a thousand in up to seven of a thousand missions (docs/estimation.md). So probabilities are those of Student's t with as
many standard deviations. By it a risk of one in a thousand asks for the normal quantile at one in a million, which is
what the shield was tuned to.
"""

from __future__ import annotations

from scipy.special import ndtr, ndtri, stdtr, stdtrit

DEGREES = 7.0
"""Degrees of freedom. Chosen: those by which the shield's confidence of 0.999 asks for its risk of 1e-6."""


def normal_risk(risk: float) -> float:
    """Probability that a normal distribution has beyond the standard deviations with which Student's t has a risk.

    >>> f"{normal_risk(1e-3):.0e}"
    '9e-07'
    """
    return float(ndtr(stdtrit(DEGREES, risk)))


def true_risk(normal: float) -> float:
    """The reverse of `normal_risk`.

    >>> round(true_risk(normal_risk(0.02)), 6)
    0.02
    """
    return float(stdtr(DEGREES, float(ndtri(min(max(normal, 1e-300), 1.0 - 1e-16)))))


def deviations(share: float) -> float:
    """Standard deviations below which a share lies.

    >>> round(deviations(0.95), 2)
    1.89
    """
    return float(stdtrit(DEGREES, share))


def scale_of(sd: float) -> float:
    """Scale with which Student's t has the central 90 % interval of a normal distribution of a standard deviation.

    For what was measured, such as the spread between runs: its interval is as wide as it was, its tails are heavier.

    >>> round(scale_of(1.0) * deviations(0.95), 3)
    1.645
    """
    return sd * float(ndtri(0.95)) / deviations(0.95)
