"""Figures with their number of drives and 95 % intervals, and scores of estimates."""

from __future__ import annotations

import math
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from benchmarks.on_the_robot.gauges.agents import Z90, Estimate
from benchmarks.tables import rate, span

Z95 = 1.96  # half the width of a normal's 95 % interval, in standard deviations


def rate_of(flags: Iterable[bool]) -> str:
    """Rate of an event with Wilson's interval and the number of drives.

    >>> rate_of([True, False])
    '50% (9% to 91%) n=2'
    """
    listed = list(flags)
    if not listed:
        return "-"
    return f"{rate(sum(listed), len(listed), '.0%')} n={len(listed)}"


def mean_of(values: Iterable[float], style: str) -> str:
    """Mean with a normal 95 % interval and the number of values; NaN is left out.

    >>> mean_of([0.1, 0.2, 0.3], ".0%")
    '20% (9% to 31%) n=3'
    """
    finite = np.array([value for value in values if math.isfinite(value)])
    if finite.size == 0:
        return "-"
    mean = float(finite.mean())
    if finite.size == 1:
        return f"{mean:{style}} n=1"
    half = Z95 * float(finite.std(ddof=1)) / math.sqrt(finite.size)
    return f"{span(mean, (mean - half, mean + half), style)} n={finite.size}"


def covers(estimate: Estimate, truth_j: float) -> bool:
    """Whether the 90 % interval contains the truth."""
    return estimate.low_j <= truth_j <= estimate.high_j


def missing() -> str | None:
    """What to install for the CRPS, in a line; None if it is there."""
    if find_spec("scoringrules") is None:
        return "No CRPS: scoringrules is not installed (pip install scoringrules)."
    return None


def crps_j(estimates: list[Estimate], truths_j: list[float]) -> list[float]:
    """Continuous ranked probability scores, J, of estimates taken as normals with their mean and 90
    % interval."""
    scoringrules = import_module("scoringrules")
    means_j = np.array([estimate.mean_j for estimate in estimates])
    widths_j = np.array([estimate.high_j - estimate.low_j for estimate in estimates])
    # an interval without width has a score all the same
    sds_j = np.maximum(widths_j / (2.0 * Z90), 1e-9)
    scores: list[float] = np.asarray(
        scoringrules.crps_normal(np.array(truths_j), means_j, sds_j)
    ).tolist()
    return scores
