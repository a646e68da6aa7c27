"""Arithmetic of a hypothesis' mean and covariance: prediction of states, and update with a
reading."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH, STATES, USED
from homeward.physics.jit import called, inline

_LEAST_VARIANCE = 1e-18
"""Variance of an innovation at least: an energy within 1e-9 of a battery is rounding. Chosen: above
0, it divides."""
_LEAST_ENERGY = 1e-9
"""Width of the range of an outlier at least, the same energy. Chosen: above 0, it divides."""


@inline
def add_energy_to_used(covariance: Any, cross_covariance: Any, jacobian: Any) -> None:
    """Covariance after an energy, linear in the states, is added to the energy used: P becomes F P
    F^T.

    F is the identity with the Jacobian added to the row of `USED`.

    Args:
        covariance: Covariance P of the states; updated.
        cross_covariance: Covariance of the energy with the states, P J^T; updated.
        jacobian: Derivative J of the energy by each state.
    """
    energy_variance = 0.0
    energy_with_used = 0.0
    for a in range(STATES):
        energy_variance += jacobian[a] * cross_covariance[a]
        energy_with_used += jacobian[a] * covariance[a, USED]
    # Of the energy by all states but the energy used, whose own row is written last.
    variance_without_used = 0.0
    for b in range(STATES):
        if b != USED:
            energy_with_state = 0.0
            for a in range(STATES):
                energy_with_state += jacobian[a] * covariance[a, b]
            variance_without_used += jacobian[b] * energy_with_state
            covariance[USED, b] += energy_with_state
            covariance[b, USED] = covariance[USED, b]
    covariance[USED, USED] += 2.0 * energy_with_used + variance_without_used
    cross_covariance[USED] += energy_variance


@inline
def propagate(covariance: Any, state: int, kept_share: float, source: int, factor: float) -> None:
    """Covariance after a state becomes `kept_share` times itself plus `factor` times the state
    `source`."""
    own_term = kept_share * kept_share * covariance[state, state]
    mixed_term = 2.0 * kept_share * factor * covariance[state, source]
    source_term = factor * factor * covariance[source, source]
    variance = own_term + mixed_term + source_term
    for a in range(STATES):
        covariance[state, a] = kept_share * covariance[state, a] + factor * covariance[source, a]
        covariance[a, state] = covariance[state, a]
    covariance[state, state] = variance


@inline
def follow_curve(
    mean: Any,
    covariance: Any,
    state: int,
    hessian: Any,
    factor: float,
    mean_wind_change: Any,
    gust_change: Any,
) -> None:
    """Follow the curve of constant rolling plus drag, after an update along its tangent.

    To second order the drag of the ground changes with the wind w by half of w^T H w more than
    along the tangent; the rolling energy is that much smaller.

    Args:
        mean: Mean of the states; updated.
        covariance: Their covariance; updated.
        state: The state of rolling, `ROLLED` or `ROLLING`.
        hessian: Second derivatives H of the energy (east, both, north): by the mean wind, and by
            its gusts, shape (2, 3).
        factor: Change of the state by an energy.
        mean_wind_change: Change of the mean wind by the update, east and north, m/s.
        gust_change: Change of the gust, east and north, m/s.
    """
    east, north = mean_wind_change
    gust_east, gust_north = gust_change
    by_mean = hessian[0]
    by_gust = hessian[1]
    # H w, by the components of mean wind and gust.
    slope_gust_east = factor * (by_gust[0] * (east + gust_east) + by_gust[1] * (north + gust_north))
    slope_gust_north = factor * (
        by_gust[1] * (east + gust_east) + by_gust[2] * (north + gust_north)
    )
    slope_east = factor * (
        by_mean[0] * east + by_mean[1] * north + by_gust[0] * gust_east + by_gust[1] * gust_north
    )
    slope_north = factor * (
        by_mean[1] * east + by_mean[2] * north + by_gust[1] * gust_east + by_gust[2] * gust_north
    )
    mean[state] -= 0.5 * (
        slope_east * east
        + slope_north * north
        + slope_gust_east * gust_east
        + slope_gust_north * gust_north
    )
    propagate(covariance, state, 1.0, EAST, -slope_east)
    propagate(covariance, state, 1.0, NORTH, -slope_north)
    propagate(covariance, state, 1.0, GUST_EAST, -slope_gust_east)
    propagate(covariance, state, 1.0, GUST_NORTH, -slope_gust_north)


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
    """Kalman update, averaged over three hypotheses: nothing changed, the ground changed, or the
    reading is an outlier.

    An outlier says nothing of the robot's parameters, but its energy was drawn: the meter counts
    what the model lacks.

    With innovation y, its variance S, cross covariance c, direction j of a change of the ground and
    its variance q:

        nothing changed:  gain K0 = c / S              P0 = P - K0 K0^T S
        ground changed:   gain K1 = (c + q j_used j) / S1,  S1 = S + q j_used^2,  P1 = P + q j j^T -
        K1 K1^T S1 outlier:          gain K2 = 1 at USED if the model can lack such a load,
        otherwise 0

    By their posterior probabilities m0, m1 and m2 the mixture has the moments (Bar-Shalom, Li and
    Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001: moments of a
    Gaussian mixture)

        K = m0 K0 + m1 K1 + m2 K2
        mean        x + K y
        covariance  m0 P0 + m1 P1 + m2 P2 + y^2 (m0 K0 K0^T + m1 K1 K1^T + m2 K2 K2^T - K K^T)

    where P2 is P, with the share `change_probability` of q j j^T.

    Args:
        mean: Mean x, shape (STATES,); updated.
        covariance: Covariance P; updated.
        innovation: Reading less prediction.
        variance: Its variance S, if the ground is as before.
        cross_covariance: Covariance c of the reading with the states, if so.
        ground_jump: Derivative j of the states by a change of the rolling resistance; the energy's
            is that of `USED`.
        change_probability: Probability of such a change.
        change_sd: Its standard deviation.
        reading: The reading.
        most_load: Largest energy that a load which the model lacks may have drawn: beyond it the
            meter is at fault.

    Returns:
        Log likelihood; normalised innovation squared.
    """
    change_variance = change_sd * change_sd
    energy_jump = ground_jump[USED]
    unchanged_variance = max(variance, _LEAST_VARIANCE)
    changed_variance = unchanged_variance + change_variance * energy_jump * energy_jump
    square = innovation * innovation

    # Probability density of the reading by each hypothesis, times its prior probability.
    unchanged = (
        (1.0 - change_probability)
        * np.exp(-0.5 * square / unchanged_variance)
        / np.sqrt(2.0 * np.pi * unchanged_variance)
    )
    changed = (
        change_probability
        * np.exp(-0.5 * square / changed_variance)
        / np.sqrt(2.0 * np.pi * changed_variance)
    )
    # An outlier is anywhere between nothing and the reading or what was predicted, whichever is
    # larger.
    outlier = thresholds.OUTLIER / max(abs(reading), abs(reading - innovation), _LEAST_ENERGY)
    total = unchanged + changed + outlier
    unchanged /= total
    changed /= total
    outlier /= total

    unchanged_weight = unchanged * (square - unchanged_variance)
    changed_weight = changed * (square - changed_variance)
    mean_change_variance = change_variance * (changed + change_probability * outlier)
    load = 0.0
    if abs(innovation) <= most_load:
        load = outlier
    for a in range(STATES):
        unchanged_gain_a = cross_covariance[a] / unchanged_variance
        changed_gain_a = (
            cross_covariance[a] + change_variance * energy_jump * ground_jump[a]
        ) / changed_variance
        load_gain_a = 1.0 if a == USED else 0.0
        gain_a = unchanged * unchanged_gain_a + changed * changed_gain_a + load * load_gain_a
        for b in range(a + 1):
            unchanged_gain_b = cross_covariance[b] / unchanged_variance
            changed_gain_b = (
                cross_covariance[b] + change_variance * energy_jump * ground_jump[b]
            ) / changed_variance
            load_gain_b = 1.0 if b == USED else 0.0
            gain_b = unchanged * unchanged_gain_b + changed * changed_gain_b + load * load_gain_b
            covariance[a, b] += (
                mean_change_variance * ground_jump[a] * ground_jump[b]
                + unchanged_weight * unchanged_gain_a * unchanged_gain_b
                + changed_weight * changed_gain_a * changed_gain_b
                - square * gain_a * gain_b
            )
            covariance[a, b] += load * square * load_gain_a * load_gain_b
            covariance[b, a] = covariance[a, b]
        mean[a] += gain_a * innovation
    normalised_square = (
        unchanged * square / unchanged_variance + changed * square / changed_variance
    )
    return float(np.log(total)), normalised_square
