"""An extended Kalman filter for each of several hypotheses about the wind, weighted by their likelihood.

Energy is linear in all states but the wind, for which the second order is included. The rolling energy of the ground
between home and here is a state of its own, `ROLLED`, as estimated on the way out; the way home crosses the same
ground. Its covariance with the wind states how much of it may be due to wind. A power reading measures rolling and drag
together: states with the same reading lie on a curve, and an update follows it (`hessian`), not its tangent.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.drive import Stretch, climbing, misread_climb, modelled_driving, predict, rolling
from homeward.estimation.kalman import add_energy_to_used, add_noise_along, follow_curve, kalman_update, propagate
from homeward.estimation.prior import (
    CLIMB,
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    OFFSET,
    PER_CAPACITY,
    ROLLED,
    ROLLING,
    SOC_ERROR,
    STATES,
    TILT,
    USED,
)
from homeward.estimation.wind import covariance_of_wind, gust_variance, quadratic_cumulants
from homeward.physics.jit import called, compiled, inline

READING_DTYPE = np.dtype(
    [
        ("time_s", np.float64),  # since the mission began
        ("position_m", np.float64),  # from home
        ("power_w", np.float64),  # mean since the last reading
        ("soc", np.float64),  # state of charge, 0 to 1
        (
            "modelled_j",
            np.float64,
        ),  # by the robot's own model since the last reading; NaN: from the slopes noted
        ("other_j", np.float64),  # if that is NaN, the model's energy beyond steady driving and standing
        ("speed_mps", np.float64),  # while it moved
        ("sine", np.float64),  # of the slope here, in the direction of the way out
        ("east", np.float64),  # direction of the way out here
        ("north", np.float64),
        ("charged_j", np.float64),  # energy that a charger supplied since the last reading
    ]
)
"""Readings of a robot; NaN where an instrument was not read."""
ROBOT_DTYPE = np.dtype(
    [(name, np.float64) for name in ("time_s", "position_m", "lag", "soc", "soc_since", "soc_taken", "soc_start")]
)
"""Time and place of the last reading; lag of the state of charge, as a share of the file's usable energy; the
state of charge, the energy used when it last changed, when it was last used, and its value at the start."""
HYPOTHESIS_DTYPE = np.dtype(
    [
        ("mean", np.float64, (STATES,)),
        ("covariance", np.float64, (STATES, STATES)),
        ("log_weight", np.float64),
        ("gust_s", np.float64),  # correlation time of the gusts
        ("rolled", np.float64),  # sum over the ground between home and here of rolling as it was met
        # Second derivatives of that ground's drag by mean wind and gusts (east, both, north), and of the ground from
        # which `ROLLING` was estimated, with its rolling by the file.
        ("hessian", np.float64, (2, 3)),
        ("hessian_here", np.float64, (2, 3)),
        ("rolls_here", np.float64),
    ]
)
PLACE_DTYPE = np.dtype([(name, np.float64) for name in ("sine", "east", "north", "readings", "sine_driven")])
"""Mean of the slope readings, direction of the way out, number of readings, and slope that was used for driving."""

_UNKNOWN = math.nan  # whether the robot coasts: neither 1 nor 0, and no integer, as numba compiles once more for those


@compiled
def update(
    vehicle: Any, prior: Any, has_reading: Any, readings: Any, robots: Any, hypotheses: Any, places: Any, rollings: Any
) -> None:
    """Update robots with their readings.

    Args:
        vehicle: `Vehicle`.
        prior: `Prior`.
        has_reading: Which robots have a reading, shape (n,).
        readings: `READING_DTYPE`, shape (n,).
        robots: `ROBOT_DTYPE`, shape (n,).
        hypotheses: `HYPOTHESIS_DTYPE`, shape (n, hypotheses).
        places: `PLACE_DTYPE`, shape (n, places).
        rollings: Rolling resistance over the file's where it was met, shape (n, hypotheses, places).
    """
    jacobian, cross_covariance, ground_jump, hessian = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(3)
    for i in range(len(has_reading)):
        robot, reading = robots[i], readings[i]
        dt_s = reading.time_s - robot.time_s
        if not has_reading[i] or not dt_s > 0.0:
            continue
        _note_ground(vehicle, robot, reading, places[i])
        used_before = mean_of(hypotheses[i], USED)
        coasts, first = _UNKNOWN, _likeliest(hypotheses[i])
        for after in range(hypotheses.shape[1]):
            k = (first + after) % hypotheses.shape[1]
            if hypotheses[i, k].log_weight > -np.inf:
                coasts = _update_hypothesis(
                    vehicle,
                    prior,
                    robot,
                    reading,
                    dt_s,
                    hypotheses[i, k],
                    places[i],
                    rollings[i, k],
                    jacobian,
                    cross_covariance,
                    ground_jump,
                    hessian,
                    coasts,
                )
            if reading.charged_j > 0.0:  # not NaN
                hypotheses[i, k].mean[USED] -= reading.charged_j / vehicle.full_j
        _normalise(hypotheses[i])
        used = mean_of(hypotheses[i], USED)
        _update_with_charge(prior, robot, reading.soc, dt_s, used, used_before, hypotheses[i])
        _normalise(hypotheses[i])
        _note_way(vehicle, robot, reading, places[i])


@inline
def place_of(vehicle: Any, position_m: float, places: Any) -> int:
    """Number of the place that a position is in; of one before the first place, or of none, the first."""
    number = position_m / vehicle.place_m
    if not number > 0.0:  # also NaN
        return 0
    # Compared before it is converted: a float beyond 64 bits has no integer, and no place.
    return int(number) if number < len(places) - 1 else len(places) - 1


@inline
def mean_of(hypotheses: Any, state: int) -> float:
    """Mean of a state over all hypotheses."""
    total = 0.0
    for k in range(len(hypotheses)):
        if hypotheses[k].log_weight > -np.inf:
            total += np.exp(hypotheses[k].log_weight) * hypotheses[k].mean[state]
    return total


@inline
def _likeliest(hypotheses: Any) -> int:
    """Number of the likeliest hypothesis."""
    best = 0
    for k in range(1, len(hypotheses)):
        if hypotheses[k].log_weight > hypotheses[best].log_weight:
            best = k
    return best


@inline
def _note_ground(vehicle: Any, robot: Any, reading: Any, places: Any) -> None:
    """Store slope and direction here on the way out, also for the places that were passed without a reading."""
    here = place_of(vehicle, reading.position_m, places)
    if reading.position_m < robot.position_m or not np.isfinite(reading.sine + reading.east + reading.north):
        return
    first = place_of(vehicle, robot.position_m, places)
    for k in range(first if places[first].readings == 0.0 else first + 1, here + 1):
        places[k].readings = 0.0
        places[k].sine, places[k].east, places[k].north = reading.sine, reading.east, reading.north
    place = places[here]
    place.readings += 1.0
    place.sine += (reading.sine - place.sine) / place.readings
    place.east, place.north = reading.east, reading.north


@inline
def _speed(robot: Any, reading: Any, dt_s: float) -> float:
    """Speed while it moved: distance over time, unless it stood for a part of the time."""
    by_way_mps = abs(reading.position_m - robot.position_m) / dt_s
    return float(reading.speed_mps if reading.speed_mps > thresholds.STOOD * by_way_mps else by_way_mps)


@called
def _update_hypothesis(
    vehicle: Any,
    prior: Any,
    robot: Any,
    reading: Any,
    dt_s: float,
    hypothesis: Any,
    places: Any,
    rollings: Any,
    jacobian: Any,
    cross_covariance: Any,
    ground_jump: Any,
    hessian: Any,
    coasts: float,
) -> float:
    """Predict a hypothesis to a reading, and update it with the power that was read.

    Returns `coasts`: whether the robot coasted, which the likeliest hypothesis, updated first, determines. `jacobian`
    is the derivative of the energy by the states before, `cross_covariance` the covariance of the reading with the
    states.
    """
    mean, covariance = hypothesis.mean, hypothesis.covariance
    _predict_gusts(prior, dt_s, hypothesis)
    outwards, way_m = reading.position_m >= robot.position_m, abs(reading.position_m - robot.position_m)
    drive, other, residual_variance, rolls, kept, climb_variance = _predict_way(
        vehicle, prior, robot, reading, dt_s, hypothesis, places, rollings, jacobian, hessian, ground_jump
    )
    mean_curvature, curvature_variance, _ = quadratic_cumulants(hessian, covariance_of_wind(covariance, 1.0, 0.0))
    drive += mean_curvature
    # A sensor that is mounted at a tilt misreads all slopes of the way out alike; for the way home, CLIMB notes it.
    weight = misread_climb(prior, mean)
    climbs = climbing(vehicle, 1.0) * way_m / vehicle.full_j if outwards and prior.slope_offset > 0.0 else 0.0
    jacobian[TILT] = weight * climbs
    drive += jacobian[TILT] * mean[TILT]
    energy_used, variance = drive + other, 0.0
    jacobian[OFFSET] = dt_s  # the reading includes the offset, the energy does not
    for a in range(STATES):
        total = 0.0
        for b in range(STATES):
            total += covariance[a, b] * jacobian[b]
        cross_covariance[a] = total
        variance += jacobian[a] * total
    jacobian[OFFSET] = 0.0
    add_energy_to_used(covariance, cross_covariance, jacobian)
    mean[USED] += energy_used
    if outwards:
        propagate(covariance, ROLLED, 1.0, ROLLING, rolls)
        mean[ROLLED] += rolls * mean[ROLLING]
        cross_covariance[ROLLED] += rolls * cross_covariance[ROLLING]
        propagate(covariance, CLIMB, 1.0, TILT, climbs)
        mean[CLIMB] += climbs * mean[TILT]
        cross_covariance[CLIMB] += climbs * cross_covariance[TILT]
    else:
        climb_kept = max(1.0 - way_m / robot.position_m, 0.0)
        propagate(covariance, ROLLED, kept, ROLLING, 0.0)
        propagate(covariance, CLIMB, climb_kept, ROLLING, 0.0)
        mean[ROLLED] *= kept
        mean[CLIMB] *= climb_kept
        cross_covariance[ROLLED] *= kept
        cross_covariance[CLIMB] *= climb_kept

    # Slopes that were misread: they raise the energy and, on the way out, recur on the way home.
    noise = (
        weight * weight * climb_variance
        + (prior.model_error * energy_used) ** 2
        + residual_variance
        + curvature_variance
    )
    covariance[USED, USED] += noise
    cross_covariance[USED] += noise
    variance += noise
    if outwards:
        covariance[CLIMB, CLIMB] += climb_variance
        covariance[CLIMB, USED] += weight * climb_variance
        covariance[USED, CLIMB] += weight * climb_variance
        cross_covariance[CLIMB] += weight * climb_variance
    else:
        # The sum of rolling is known better than that of each place: what one consumed more, the others consumed less.
        uneven = (thresholds.UNEVEN * prior.patch_sd * rolls) ** 2
        covariance[ROLLED, ROLLED] += uneven
        covariance[USED, USED] += uneven
        covariance[ROLLED, USED] -= uneven
        covariance[USED, ROLLED] -= uneven
        cross_covariance[ROLLED] -= uneven
        cross_covariance[USED] += uneven
        variance += uneven

    ground_jump[:] = 0.0
    change = 0.0
    if outwards and way_m > 0.0:
        change = 1.0 - np.exp(-way_m / prior.patch_m)
        ground_jump[ROLLING], ground_jump[ROLLED], ground_jump[USED] = 1.0, rolls, jacobian[ROLLING]
    fades = np.exp(-dt_s / hypothesis.gust_s)
    for a in range(3):
        hypothesis.hessian[0, a] = (
            hypothesis.hessian[0, a] + hessian[a] if outwards else kept * hypothesis.hessian[0, a]
        )
        hypothesis.hessian[1, a] = (
            fades * hypothesis.hessian[1, a] + hessian[a] if outwards else fades * kept * hypothesis.hessian[1, a]
        )
        hypothesis.hessian_here[0, a] += hessian[a] if outwards else 0.0
        hypothesis.hessian_here[1, a] = fades * hypothesis.hessian_here[1, a] + (hessian[a] if outwards else 0.0)
    hypothesis.rolls_here += rolls if outwards else 0.0
    coasts = _update_with_power(
        prior,
        reading.power_w * dt_s / vehicle.full_j,
        energy_used + mean[OFFSET] * dt_s,
        variance,
        residual_variance,
        drive,
        rolls,
        hypothesis,
        cross_covariance,
        ground_jump,
        change,
        coasts,
        thresholds.MOST_LOADS * (vehicle.idle_w * dt_s + rolling(vehicle, 0.0) * way_m) / vehicle.full_j,
    )
    _note_rolling(vehicle, robot, reading, hypothesis, places, rollings, rolls)
    return coasts


@inline
def _update_with_power(
    prior: Any,
    read: float,
    predicted: float,
    variance: float,
    residual_variance: float,
    drive: float,
    rolls: float,
    hypothesis: Any,
    cross_covariance: Any,
    ground_jump: Any,
    change: float,
    coasts: float,
    most: float,
) -> float:
    """Update with a reading of energy, over the file's usable energy; returns `coasts`. `most`: see `kalman_update`."""
    mean, covariance = hypothesis.mean, hypothesis.covariance
    if not np.isfinite(read):
        add_noise_along(covariance, ground_jump, change * prior.patch_sd**2)
        return coasts
    variance += (prior.power_noise * read) ** 2
    if math.isnan(coasts):
        coasts = 1.0 if read - predicted + drive < thresholds.COASTS * rolls and rolls > 0.0 else 0.0
    if coasts == 1.0:
        # All hypotheses use the same decision, as the density of one and the probability of another cannot be compared.
        may = 0.5 * math.erfc((drive - thresholds.COASTS * rolls) / math.sqrt(2.0 * max(variance, 1e-18)))
        hypothesis.log_weight += thresholds.TEMPER * np.log(max(may, thresholds.LEAST_CHANCE))
        if residual_variance > 0.0:
            # The prediction includes that it may coast: the other states keep their estimates.
            mean[USED] += read - predicted
            for a in range(STATES):
                if a != USED:
                    covariance[USED, a], covariance[a, USED] = 0.0, 0.0
            return coasts
    east_mps, north_mps, gust_east_mps, gust_north_mps = mean[EAST], mean[NORTH], mean[GUST_EAST], mean[GUST_NORTH]
    log_likelihood, nis = kalman_update(
        mean, covariance, read - predicted, variance, cross_covariance, ground_jump, change, prior.patch_sd, read, most
    )
    if coasts == 0.0:
        hypothesis.log_weight += thresholds.TEMPER * log_likelihood
    # A normalised innovation squared above 1 indicates gusts that change faster.
    gust_s = hypothesis.gust_s * np.exp(-thresholds.ADAPT * (min(nis, thresholds.DOUBT) - 1.0))
    hypothesis.gust_s = min(max(gust_s, prior.shortest_gust_s), prior.longest_gust_s)
    by_mean_mps = mean[EAST] - east_mps, mean[NORTH] - north_mps
    by_gust_mps = mean[GUST_EAST] - gust_east_mps, mean[GUST_NORTH] - gust_north_mps
    follow_curve(mean, covariance, ROLLED, hypothesis.hessian, 1.0, by_mean_mps, by_gust_mps)
    follow_curve(
        mean,
        covariance,
        ROLLING,
        hypothesis.hessian_here,
        1.0 / max(hypothesis.rolls_here, 1e-12),
        by_mean_mps,
        by_gust_mps,
    )
    # For new ground it is not known.
    for a in range(3):
        hypothesis.hessian_here[0, a] *= 1.0 - change
        hypothesis.hessian_here[1, a] *= 1.0 - change
    hypothesis.rolls_here *= 1.0 - change
    return coasts


@inline
def _predict_gusts(prior: Any, dt_s: float, hypothesis: Any) -> None:
    """Predict the gusts."""
    mean, covariance, kept = hypothesis.mean, hypothesis.covariance, np.exp(-dt_s / hypothesis.gust_s)
    variance = gust_variance(prior, mean, covariance)
    for gust in (GUST_EAST, GUST_NORTH):
        mean[gust] *= kept
        for a in range(STATES):
            covariance[gust, a] *= kept
            covariance[a, gust] *= kept
        covariance[gust, gust] += variance * (1.0 - kept * kept)


@called
def _predict_way(
    vehicle: Any,
    prior: Any,
    robot: Any,
    reading: Any,
    dt_s: float,
    hypothesis: Any,
    places: Any,
    rollings: Any,
    jacobian: Any,
    hessian: Any,
    stretch_jacobian: Any,
) -> tuple[float, float, float, float, float, float]:
    """Energy since the last reading, and its derivatives: first by each state (`jacobian`) and second by the wind
    (`hessian`).

    Returns:
        Energy of driving; of all else; variance beyond that of the states; rolling by the file; share of the ground's
        rolling between home and here that remains; variance of climbing by the file due to misread slopes.
    """
    mean, covariance = hypothesis.mean, hypothesis.covariance
    outwards = reading.position_m >= robot.position_m
    ahead = 1.0 if outwards else -1.0
    reached_m, end_m = min(robot.position_m, reading.position_m), max(robot.position_m, reading.position_m)
    speed_mps = _speed(robot, reading, dt_s)
    per_rolled = 1.0 / max(hypothesis.rolled, 1e-12)
    jacobian[:], hessian[:] = 0.0, 0.0
    own = energy_used = variance = rolls = met = climb_variance = 0.0
    k = place_of(vehicle, reached_m, places)
    while reached_m < end_m:
        border_m = min((k + 1) * vehicle.place_m, end_m) if k < len(places) - 1 else end_m
        way_m, place = max(border_m - reached_m, 0.0), places[k]
        sine = ahead * (place.sine if outwards else place.sine_driven)
        roll = rolling(vehicle, sine) * way_m / vehicle.full_j
        again = -1.0 if outwards else rollings[k] * per_rolled
        home_share = way_m / max(robot.position_m, 1e-9)
        stretch = Stretch(way_m, sine, ahead * place.east, ahead * place.north, speed_mps, again, home_share, 1.0)
        energy, residual_variance = predict(
            vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
        )
        own += modelled_driving(vehicle, sine, speed_mps) * way_m / vehicle.full_j
        energy_used += energy
        variance += residual_variance
        rolls += roll
        met += rollings[k] * roll * per_rolled
        slope_variance = prior.slope_noise**2 / max(place.readings, 1.0) + prior.slope_within_place**2
        climb_variance += (climbing(vehicle, 1.0) * way_m / vehicle.full_j) ** 2 * slope_variance
        reached_m, k = max(border_m, reached_m), min(k + 1, len(places) - 1)
    idle = (vehicle.idle_w * dt_s + reading.other_j) / vehicle.full_j
    if np.isfinite(reading.modelled_j):
        idle = reading.modelled_j / vehicle.full_j - own
    jacobian[GAIN] += idle
    return energy_used, mean[GAIN] * idle, variance, rolls, max(1.0 - met, 0.0), climb_variance


@inline
def _note_rolling(
    vehicle: Any, robot: Any, reading: Any, hypothesis: Any, places: Any, rollings: Any, rolls: float
) -> None:
    """Store the rolling resistance by place, as estimated on the way out."""
    if reading.position_m < robot.position_m:
        kept_m = reading.position_m
        total = 0.0
        for k in range(place_of(vehicle, kept_m, places) + 1):
            total += (
                rollings[k]
                * rolling(vehicle, places[k].sine_driven)
                * max(min(vehicle.place_m, kept_m - k * vehicle.place_m), 0.0)
            )
        hypothesis.rolled = total / vehicle.full_j
        return
    rolling_now, reached_m = max(hypothesis.mean[ROLLING], thresholds.LEAST_ROLLING), robot.position_m
    k = place_of(vehicle, reached_m, places)
    while reached_m < reading.position_m:
        border_m = min((k + 1) * vehicle.place_m, reading.position_m) if k < len(places) - 1 else reading.position_m
        part_m = max(border_m - reached_m, 0.0)
        before_m = max(reached_m - k * vehicle.place_m, 0.0)
        rollings[k] += (rolling_now - rollings[k]) * part_m / max(part_m + before_m, 1e-9)
        reached_m, k = max(border_m, reached_m), min(k + 1, len(places) - 1)
    hypothesis.rolled += rolling_now * rolls


@inline
def _note_way(vehicle: Any, robot: Any, reading: Any, places: Any) -> None:
    """Store the robot's place, and the slopes that were used for its way out."""
    reached_m = robot.position_m
    k = place_of(vehicle, reached_m, places)
    while reached_m < reading.position_m:
        border_m = min((k + 1) * vehicle.place_m, reading.position_m) if k < len(places) - 1 else reading.position_m
        part_m = max(border_m - reached_m, 0.0)
        before_m = max(reached_m - k * vehicle.place_m, 0.0)
        places[k].sine_driven += (places[k].sine - places[k].sine_driven) * part_m / max(part_m + before_m, 1e-9)
        reached_m, k = max(border_m, reached_m), min(k + 1, len(places) - 1)
    robot.time_s, robot.position_m = reading.time_s, reading.position_m


@called
def _update_with_charge(
    prior: Any, robot: Any, soc: float, dt_s: float, used: float, used_before: float, hypotheses: Any
) -> None:
    """Update with a state of charge: energy used over the capacity.

    Args:
        prior: `Prior`.
        robot: `ROBOT_DTYPE`.
        soc: The reading, 0 to 1.
        dt_s: Time since the last reading, s.
        used: Energy used by the likeliest hypothesis.
        used_before: The same at the last reading.
        hypotheses: `HYPOTHESIS_DTYPE`, shape (hypotheses,).
    """
    # A first-order lag behind what is used at a constant power.
    kept = np.exp(-dt_s / prior.soc_lag_s) if prior.soc_lag_s > 0.0 else 0.0
    per_lag = prior.soc_lag_s / dt_s * (1.0 - kept)
    robot.lag = kept * robot.lag + per_lag * (used - used_before)
    lasts = np.exp(-abs(used - used_before) / prior.soc_error_lasts)
    for k in range(len(hypotheses)):
        mean, covariance = hypotheses[k].mean, hypotheses[k].covariance
        propagate(covariance, SOC_ERROR, lasts, SOC_ERROR, 0.0)
        mean[SOC_ERROR] *= lasts
        covariance[SOC_ERROR, SOC_ERROR] += prior.soc_error**2 * (1.0 - lasts * lasts)
    if not np.isfinite(soc):
        return
    if soc != robot.soc:
        robot.soc, robot.soc_since = soc, used
    else:
        most = thresholds.STUCK_STEPS * prior.soc_step + thresholds.STUCK_NOISE * prior.soc_noise + thresholds.STUCK
        if used - robot.soc_since > most:
            return
    # Rounding errors repeat until noise or consumption changes the reading by a step.
    step, noise = max(prior.soc_step, 1e-9), prior.soc_noise
    alike = np.exp(-((2.0 * np.pi * noise / step) ** 2)) * max(1.0 - abs(used - robot.soc_taken) / step, 0.0)
    robot.soc_taken = used
    error = (step * step / 12.0 + noise * noise + thresholds.LEAST_SOC_ERROR**2) / max(
        1.0 - alike, thresholds.LEAST_INDEPENDENT
    )
    for k in range(len(hypotheses)):
        hypothesis = hypotheses[k]
        if hypothesis.log_weight > -np.inf:
            mean, covariance = hypothesis.mean, hypothesis.covariance
            spent, per_capacity = mean[USED] - robot.lag, mean[PER_CAPACITY]
            innovation = robot.soc_start - soc - per_capacity * spent + mean[SOC_ERROR]
            variance = error
            gain = np.empty(STATES)
            for a in range(STATES):
                gain[a] = (
                    spent * covariance[a, PER_CAPACITY] + per_capacity * covariance[a, USED] - covariance[a, SOC_ERROR]
                )
            variance += spent * gain[PER_CAPACITY] + per_capacity * gain[USED] - gain[SOC_ERROR]
            variance = max(variance, innovation * innovation / thresholds.DOUBT)
            for a in range(STATES):
                mean[a] += gain[a] * innovation / variance
                for b in range(STATES):
                    covariance[a, b] -= gain[a] * gain[b] / variance
            hypothesis.log_weight -= 0.5 * (innovation * innovation / variance + np.log(variance))


@inline
def _normalise(hypotheses: Any) -> None:
    """Normalise the weights to a sum of one, with a lower limit for each."""
    most, total = -np.inf, 0.0
    for k in range(len(hypotheses)):
        most = max(most, hypotheses[k].log_weight)
    for k in range(len(hypotheses)):
        if hypotheses[k].log_weight > -np.inf:
            hypotheses[k].log_weight = max(hypotheses[k].log_weight - most, thresholds.LEAST_LOG_WEIGHT)
            total += np.exp(hypotheses[k].log_weight)
    for k in range(len(hypotheses)):
        hypotheses[k].log_weight -= np.log(total)
