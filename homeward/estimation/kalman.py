"""Arithmetic of a hypothesis' mean and covariance: prediction of states, and update with a reading."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH, STATES, USED
from homeward.physics.jit import called, inline


@inline
def add_to_used(p: Any, shared: Any, slope: Any) -> None:
    """Covariance after an energy, linear in the states by `slope`, is added to the energy used."""
    own = with_used = again = 0.0
    for a in range(STATES):
        own += slope[a] * shared[a]
        with_used += slope[a] * p[a, USED]
    for b in range(STATES):
        if b != USED:
            total = 0.0
            for a in range(STATES):
                total += slope[a] * p[a, b]
            again += slope[b] * total
            p[USED, b] += total
            p[b, USED] = p[USED, b]
    p[USED, USED] += 2.0 * with_used + again
    shared[USED] += own


@inline
def carry(p: Any, row: int, kept: float, source: int, factor: float) -> None:
    """Covariance after a state becomes a share of itself and a factor times another one."""
    own = kept * kept * p[row, row] + 2.0 * kept * factor * p[row, source] + factor * factor * p[source, source]
    for a in range(STATES):
        p[row, a] = kept * p[row, a] + factor * p[source, a]
        p[a, row] = p[row, a]
    p[row, row] = own


@inline
def bend_along(x: Any, p: Any, row: int, bend: Any, factor: float, by_mean_mps: Any, by_gust_mps: Any) -> None:
    """Follow the curve of constant rolling plus drag, after an update along its tangent."""
    (east, north), (gust_east, gust_north) = by_mean_mps, by_gust_mps
    by_gust_east = factor * (bend[1, 0] * (east + gust_east) + bend[1, 1] * (north + gust_north))
    by_gust_north = factor * (bend[1, 1] * (east + gust_east) + bend[1, 2] * (north + gust_north))
    by_east = factor * (bend[0, 0] * east + bend[0, 1] * north + bend[1, 0] * gust_east + bend[1, 1] * gust_north)
    by_north = factor * (bend[0, 1] * east + bend[0, 2] * north + bend[1, 1] * gust_east + bend[1, 2] * gust_north)
    x[row] -= 0.5 * (by_east * east + by_north * north + by_gust_east * gust_east + by_gust_north * gust_north)
    carry(p, row, 1.0, EAST, -by_east)
    carry(p, row, 1.0, NORTH, -by_north)
    carry(p, row, 1.0, GUST_EAST, -by_gust_east)
    carry(p, row, 1.0, GUST_NORTH, -by_gust_north)


@inline
def spread(p: Any, direction: Any, variance: float) -> None:
    """Covariance after a random change of the states along a direction."""
    for a in range(STATES):
        for b in range(STATES):
            p[a, b] += variance * direction[a] * direction[b]


@called
def kalman_update(
    x: Any,
    p: Any,
    innovation: float,
    variance: float,
    shared: Any,
    jump: Any,
    change: float,
    change_sd: float,
    read: float,
    most: float,
) -> tuple[float, float]:
    """Kalman update, averaged over three hypotheses: nothing changed, the ground changed, or the reading is an outlier.

    An outlier says nothing of the robot's parameters, but its energy was drawn: the meter counts what the model lacks.

    Args:
        x: Mean, shape (STATES,).
        p: Covariance.
        innovation: Reading less prediction.
        variance: Its variance, if the ground is as before.
        shared: Covariance of the reading with the states, if so.
        jump: Derivative of the states by a change of the rolling resistance; the energy's is that of `USED`.
        change: Probability of such a change.
        change_sd: Its standard deviation.
        read: The reading.
        most: Largest energy that a load which the model lacks may have drawn: beyond it the meter is at fault.

    Returns:
        Log likelihood; normalised innovation squared.
    """
    q = change_sd * change_sd
    rise = jump[USED]
    variance, changed = max(variance, 1e-18), max(variance, 1e-18) + q * rise * rise
    square = innovation * innovation
    same = (1.0 - change) * np.exp(-0.5 * square / variance) / np.sqrt(2.0 * np.pi * variance)
    other = change * np.exp(-0.5 * square / changed) / np.sqrt(2.0 * np.pi * changed)
    nothing = thresholds.OUTLIER / max(abs(read), abs(read - innovation), 1e-9)
    total = same + other + nothing
    same, other, outlier = same / total, other / total, nothing / total
    weight_0, weight_1 = same * (square - variance), other * (square - changed)
    q_mean = q * (other + change * outlier)
    drawn = outlier if abs(innovation) <= most else 0.0
    for a in range(STATES):
        k_0, k_1 = shared[a] / variance, (shared[a] + q * rise * jump[a]) / changed
        k_2 = 1.0 if a == USED else 0.0
        k_a = same * k_0 + other * k_1 + drawn * k_2
        for b in range(a + 1):
            l_0, l_1 = shared[b] / variance, (shared[b] + q * rise * jump[b]) / changed
            l_2 = 1.0 if b == USED else 0.0
            l_a = same * l_0 + other * l_1 + drawn * l_2
            p[a, b] += q_mean * jump[a] * jump[b] + weight_0 * k_0 * l_0 + weight_1 * k_1 * l_1 - square * k_a * l_a
            p[a, b] += drawn * square * k_2 * l_2
            p[b, a] = p[a, b]
        x[a] += k_a * innovation
    return float(np.log(total)), same * square / variance + other * square / changed
