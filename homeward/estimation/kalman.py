"""Arithmetic of a hypothesis' mean and covariance: prediction of states, and update with a reading."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH, STATES, USED
from homeward.physics.jit import called, inline


@inline
def add_energy_to_used(covariance: Any, cross_covariance: Any, jacobian: Any) -> None:
    """Covariance after an energy, linear in the states by `jacobian`, is added to the energy used."""
    own = with_used = again = 0.0
    for a in range(STATES):
        own += jacobian[a] * cross_covariance[a]
        with_used += jacobian[a] * covariance[a, USED]
    for b in range(STATES):
        if b != USED:
            total = 0.0
            for a in range(STATES):
                total += jacobian[a] * covariance[a, b]
            again += jacobian[b] * total
            covariance[USED, b] += total
            covariance[b, USED] = covariance[USED, b]
    covariance[USED, USED] += 2.0 * with_used + again
    cross_covariance[USED] += own


@inline
def propagate(covariance: Any, row: int, kept: float, source: int, factor: float) -> None:
    """Covariance after a state becomes a share of itself and a factor times another one."""
    own = (
        kept * kept * covariance[row, row]
        + 2.0 * kept * factor * covariance[row, source]
        + factor * factor * covariance[source, source]
    )
    for a in range(STATES):
        covariance[row, a] = kept * covariance[row, a] + factor * covariance[source, a]
        covariance[a, row] = covariance[row, a]
    covariance[row, row] = own


@inline
def follow_curve(
    mean: Any, covariance: Any, row: int, hessian: Any, factor: float, by_mean_mps: Any, by_gust_mps: Any
) -> None:
    """Follow the curve of constant rolling plus drag, after an update along its tangent."""
    (east, north), (gust_east, gust_north) = by_mean_mps, by_gust_mps
    by_gust_east = factor * (hessian[1, 0] * (east + gust_east) + hessian[1, 1] * (north + gust_north))
    by_gust_north = factor * (hessian[1, 1] * (east + gust_east) + hessian[1, 2] * (north + gust_north))
    by_east = factor * (
        hessian[0, 0] * east + hessian[0, 1] * north + hessian[1, 0] * gust_east + hessian[1, 1] * gust_north
    )
    by_north = factor * (
        hessian[0, 1] * east + hessian[0, 2] * north + hessian[1, 1] * gust_east + hessian[1, 2] * gust_north
    )
    mean[row] -= 0.5 * (by_east * east + by_north * north + by_gust_east * gust_east + by_gust_north * gust_north)
    propagate(covariance, row, 1.0, EAST, -by_east)
    propagate(covariance, row, 1.0, NORTH, -by_north)
    propagate(covariance, row, 1.0, GUST_EAST, -by_gust_east)
    propagate(covariance, row, 1.0, GUST_NORTH, -by_gust_north)


@inline
def add_noise_along(covariance: Any, direction: Any, variance: float) -> None:
    """Covariance after a random change of the states along a direction."""
    for a in range(STATES):
        for b in range(STATES):
            covariance[a, b] += variance * direction[a] * direction[b]


@called
def kalman_update(
    mean: Any,
    covariance: Any,
    innovation: float,
    variance: float,
    cross_covariance: Any,
    ground_jump: Any,
    change_probability: float,
    change_sd: float,
    reading: float,
    most_load: float,
) -> tuple[float, float]:
    """Kalman update, averaged over three hypotheses: nothing changed, the ground changed, or the reading is an outlier.

    An outlier says nothing of the robot's parameters, but its energy was drawn: the meter counts what the model lacks.

    Args:
        mean: Mean, shape (STATES,).
        covariance: Covariance.
        innovation: Reading less prediction.
        variance: Its variance, if the ground is as before.
        cross_covariance: Covariance of the reading with the states, if so.
        ground_jump: Derivative of the states by a change of the rolling resistance; the energy's is that of `USED`.
        change_probability: Probability of such a change.
        change_sd: Its standard deviation.
        reading: The reading.
        most_load: Largest energy that a load which the model lacks may have drawn: beyond it the meter is at fault.

    Returns:
        Log likelihood; normalised innovation squared.
    """
    q = change_sd * change_sd
    rise = ground_jump[USED]
    variance, changed = max(variance, 1e-18), max(variance, 1e-18) + q * rise * rise
    square = innovation * innovation
    same = (1.0 - change_probability) * np.exp(-0.5 * square / variance) / np.sqrt(2.0 * np.pi * variance)
    other = change_probability * np.exp(-0.5 * square / changed) / np.sqrt(2.0 * np.pi * changed)
    nothing = thresholds.OUTLIER / max(abs(reading), abs(reading - innovation), 1e-9)
    total = same + other + nothing
    same, other, outlier = same / total, other / total, nothing / total
    weight_0, weight_1 = same * (square - variance), other * (square - changed)
    q_mean = q * (other + change_probability * outlier)
    drawn = outlier if abs(innovation) <= most_load else 0.0
    for a in range(STATES):
        k_0, k_1 = cross_covariance[a] / variance, (cross_covariance[a] + q * rise * ground_jump[a]) / changed
        k_2 = 1.0 if a == USED else 0.0
        k_a = same * k_0 + other * k_1 + drawn * k_2
        for b in range(a + 1):
            l_0, l_1 = cross_covariance[b] / variance, (cross_covariance[b] + q * rise * ground_jump[b]) / changed
            l_2 = 1.0 if b == USED else 0.0
            l_a = same * l_0 + other * l_1 + drawn * l_2
            covariance[a, b] += (
                q_mean * ground_jump[a] * ground_jump[b]
                + weight_0 * k_0 * l_0
                + weight_1 * k_1 * l_1
                - square * k_a * l_a
            )
            covariance[a, b] += drawn * square * k_2 * l_2
            covariance[b, a] = covariance[a, b]
        mean[a] += k_a * innovation
    return float(np.log(total)), same * square / variance + other * square / changed
