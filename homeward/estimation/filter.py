"""An extended Kalman filter for each of several hypotheses about the wind, weighted by their
likelihood.

Energy is linear in all states but the wind, for which the second order is included. The rolling
energy of the ground between home and here is a state of its own, `ROLLED`, as estimated on the way
out; the way home crosses the same ground. Its covariance with the wind states how much of it may be
due to wind. A power reading measures rolling and drag together: states with the same reading lie on
a curve, and an update follows it (`hessian`), not its tangent.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.drive import (
    LEAST_ROLLED,
    LEAST_WAY_M,
    Stretch,
    climbing,
    misread_climb,
    modelled_driving,
    predict,
    rolling,
)
from homeward.estimation.kalman import (
    add_energy_to_used,
    add_noise_along,
    follow_curve,
    kalman_update,
    propagate,
)
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
        # by the robot's own model since the last reading; NaN: from the slopes noted
        ("modelled_j", np.float64),
        # if that is NaN, the model's energy beyond steady driving and standing
        ("other_j", np.float64),
        ("speed_mps", np.float64),  # while it moved
        ("sine", np.float64),  # of the slope here, in the direction of the way out
        ("east", np.float64),  # direction of the way out here
        ("north", np.float64),
        ("charged_j", np.float64),  # energy that a charger supplied since the last reading
    ]
)
"""Readings of a robot; NaN where an instrument was not read."""
ROBOT_DTYPE = np.dtype(
    [
        (name, np.float64)
        for name in ("time_s", "position_m", "lag", "soc", "soc_since", "soc_taken", "soc_start")
    ]
)
"""Time and place of the last reading; lag of the state of charge, as a share of the file's usable
energy; the state of charge, the energy used when it last changed, when it was last used, and its
value at the start."""
HYPOTHESIS_DTYPE = np.dtype(
    [
        ("mean", np.float64, (STATES,)),
        ("covariance", np.float64, (STATES, STATES)),
        ("log_weight", np.float64),
        ("gust_s", np.float64),  # correlation time of the gusts
        # sum over the ground between home and here of rolling as it was met
        ("rolled", np.float64),
        # Second derivatives of that ground's drag by mean wind and gusts (east, both, north), and
        # of the ground from which `ROLLING` was estimated, with its rolling by the file.
        ("hessian", np.float64, (2, 3)),
        ("hessian_here", np.float64, (2, 3)),
        ("rolls_here", np.float64),
    ]
)
PLACE_DTYPE = np.dtype(
    [(name, np.float64) for name in ("sine", "east", "north", "readings", "sine_driven")]
)
"""Mean of the slope readings, direction of the way out, number of readings, and slope that was used
for driving."""


class Workspace(NamedTuple):
    """Arrays that an update writes and then reads: made once for all robots, as to allocate in a
    loop is slow."""

    jacobian: Any  # derivative of the energy since the last reading by each state, shape (STATES,)
    hessian: Any  # its second derivatives by the wind: east, both, north
    cross_covariance: Any  # covariance of the reading with the states, shape (STATES,)
    # derivative of each state by a change of the ground's rolling resistance, shape (STATES,)
    ground_jump: Any
    stretch_jacobian: Any  # derivative of the energy of a stretch by each state, shape (STATES,)


class WayEnergy(NamedTuple):
    """Energy since the last reading by a hypothesis, as shares of the file's usable energy."""

    driving: float
    not_driving: float  # of everything but driving
    residual_variance: float  # of driving, beyond that of the states
    rolls: float  # rolling by the file
    rolled_kept: float  # share of the ground's rolling between home and here that remains
    climb_variance: float  # of climbing by the file, due to misread slopes


_LEAST_VARIANCE = 1e-18
"""Least variance of an energy, of a battery squared. Chosen: above 0, because its root divides."""
_LEAST_STEP = 1e-9
"""Least step of a state of charge. Chosen: above 0, because it divides."""
# whether the robot coasts: neither 1 nor 0, and no integer, as numba compiles once more for those
_UNKNOWN = math.nan


@compiled
def update(
    vehicle: Any,
    prior: Any,
    has_reading: Any,
    readings: Any,
    robots: Any,
    hypotheses: Any,
    places: Any,
    rollings: Any,
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
        rollings: Rolling resistance over the file's where it was met, shape (n, hypotheses,
            places).
    """
    work = Workspace(
        jacobian=np.zeros(STATES),
        hessian=np.zeros(3),
        cross_covariance=np.zeros(STATES),
        ground_jump=np.zeros(STATES),
        stretch_jacobian=np.zeros(STATES),
    )
    count = hypotheses.shape[1]
    for i in range(len(has_reading)):
        robot = robots[i]
        reading = readings[i]
        dt_s = reading.time_s - robot.time_s
        if not has_reading[i] or not dt_s > 0.0:
            continue
        _note_ground(vehicle, robot, reading, places[i])
        used_before = mean_of(hypotheses[i], USED)
        # The likeliest hypothesis comes first, because it decides for all whether the robot coasts.
        likeliest = _likeliest(hypotheses[i])
        coasts = _UNKNOWN
        for offset in range(count):
            k = (likeliest + offset) % count
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
                    work,
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
    """Number of the place that a position is in; of one before the first place, or of none, the
    first."""
    number = position_m / vehicle.place_m
    if not number > 0.0:  # also NaN
        return 0
    # Compared before it is converted: a float beyond 64 bits has no integer, and no place.
    if number < len(places) - 1:
        return int(number)
    return len(places) - 1


@inline
def _leaves_place_m(vehicle: Any, place: int, places: Any, end_m: float) -> float:
    """Where a way that ends at `end_m` leaves a place, m from home; the last place has no end."""
    if place < len(places) - 1:
        return float(min((place + 1) * vehicle.place_m, end_m))
    return end_m


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
    likeliest = 0
    for k in range(1, len(hypotheses)):
        if hypotheses[k].log_weight > hypotheses[likeliest].log_weight:
            likeliest = k
    return likeliest


@inline
def _note_ground(vehicle: Any, robot: Any, reading: Any, places: Any) -> None:
    """Store slope and direction here on the way out, also for the places that were passed without a
    reading."""
    homewards = reading.position_m < robot.position_m
    if homewards or not np.isfinite(reading.sine + reading.east + reading.north):
        return
    place_before = place_of(vehicle, robot.position_m, places)
    place_now = place_of(vehicle, reading.position_m, places)
    first_new = place_before + 1
    if places[place_before].readings == 0.0:
        first_new = place_before
    for k in range(first_new, place_now + 1):
        places[k].readings = 0.0
        places[k].sine = reading.sine
        places[k].east = reading.east
        places[k].north = reading.north
    place = places[place_now]
    place.readings += 1.0
    place.sine += (reading.sine - place.sine) / place.readings
    place.east = reading.east
    place.north = reading.north


@inline
def _speed(robot: Any, reading: Any, dt_s: float) -> float:
    """Speed while it moved: distance over time, unless it stood for a part of the time."""
    by_way_mps = abs(reading.position_m - robot.position_m) / dt_s
    if reading.speed_mps > thresholds.STOOD * by_way_mps:
        return float(reading.speed_mps)
    return float(by_way_mps)


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
    work: Any,
    coasts: float,
) -> float:
    """Predict a hypothesis to a reading, and update it with the power that was read.

    A step of an extended Kalman filter that is of second order in the wind (Anderson and Moore,
    Optimal Filtering, 1979, chapter 8). With mean x and covariance P of the states, energies as
    shares of the file's usable energy:

        energy       E = E_driving(x) + tr(H W) / 2 + J_tilt x_tilt + E_other
        reading      z = power dt / full,  predicted as E + x_offset dt
        innovation   y = z - E - x_offset dt
        covariances  c = P J^T + q_c of y with the states,  S = J P J^T + q_S of y itself
        states       x_used += E,  P = F P F^T + Q

    J is the Jacobian of the reading, H the Hessian of E by the wind and W the covariance of the
    wind. F adds E to the energy used, and the ground that was driven to that between home and here
    (`_add_ground`) or takes it away (`_leave_ground`). Q, q_c and q_S are the noise of misread
    slopes, of what the model omits, and of uneven ground. `_update_with_power` is the update by y,
    c and S.

    Args:
        vehicle: `Vehicle`.
        prior: `Prior`.
        robot: `ROBOT_DTYPE`: time and place of the last reading.
        reading: `READING_DTYPE`.
        dt_s: Time since the last reading, s.
        hypothesis: `HYPOTHESIS_DTYPE`; updated.
        places: `PLACE_DTYPE`, shape (places,).
        rollings: Rolling resistance over the file's where it was met, shape (places,); updated.
        work: `Workspace`; written.
        coasts: Whether the robot coasts, 1 or 0; NaN for the hypothesis that decides it.

    Returns:
        `coasts`, decided.
    """
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    jacobian = work.jacobian
    cross_covariance = work.cross_covariance
    outwards = reading.position_m >= robot.position_m
    way_m = abs(reading.position_m - robot.position_m)

    _predict_gusts(prior, dt_s, hypothesis)
    way = _predict_way(vehicle, prior, robot, reading, dt_s, hypothesis, places, rollings, work)
    wind_covariance = covariance_of_wind(covariance, 1.0, 0.0)
    curvature_mean, curvature_variance, _ = quadratic_cumulants(work.hessian, wind_covariance)
    driving = way.driving + curvature_mean
    # A sensor that is mounted at a tilt misreads all slopes of the way out alike; for the way home,
    # CLIMB notes it.
    climb_weight = misread_climb(prior, mean)
    tilt_climb = 0.0
    if outwards and prior.slope_offset > 0.0:
        tilt_climb = climbing(vehicle, 1.0) * way_m / vehicle.full_j
    jacobian[TILT] = climb_weight * tilt_climb
    driving += jacobian[TILT] * mean[TILT]
    energy = driving + way.not_driving

    jacobian[OFFSET] = dt_s  # the reading includes the offset, the energy does not
    variance = _write_cross_covariance(covariance, jacobian, cross_covariance)
    jacobian[OFFSET] = 0.0
    add_energy_to_used(covariance, cross_covariance, jacobian)
    mean[USED] += energy
    if outwards:
        _add_ground(mean, covariance, cross_covariance, way.rolls, tilt_climb)
    else:
        climb_kept = max(1.0 - way_m / robot.position_m, 0.0)
        _leave_ground(mean, covariance, cross_covariance, way.rolled_kept, climb_kept)

    # Slopes that were misread raise the energy and, on the way out, recur on the way home.
    noise = (
        climb_weight * climb_weight * way.climb_variance
        + (prior.model_error * energy) ** 2
        + way.residual_variance
        + curvature_variance
    )
    covariance[USED, USED] += noise
    cross_covariance[USED] += noise
    variance += noise
    if outwards:
        climb_with_energy = climb_weight * way.climb_variance
        covariance[CLIMB, CLIMB] += way.climb_variance
        covariance[CLIMB, USED] += climb_with_energy
        covariance[USED, CLIMB] += climb_with_energy
        cross_covariance[CLIMB] += climb_with_energy
    else:
        # The sum of rolling is known better than that of each place: what one consumed more, the
        # others consumed less.
        uneven_variance = (thresholds.UNEVEN * prior.patch_sd * way.rolls) ** 2
        covariance[ROLLED, ROLLED] += uneven_variance
        covariance[USED, USED] += uneven_variance
        covariance[ROLLED, USED] -= uneven_variance
        covariance[USED, ROLLED] -= uneven_variance
        cross_covariance[ROLLED] -= uneven_variance
        cross_covariance[USED] += uneven_variance
        variance += uneven_variance

    work.ground_jump[:] = 0.0
    change_probability = 0.0
    if outwards and way_m > 0.0:
        change_probability = 1.0 - np.exp(-way_m / prior.patch_m)
        work.ground_jump[ROLLING] = 1.0
        work.ground_jump[ROLLED] = way.rolls
        work.ground_jump[USED] = jacobian[ROLLING]
    _note_hessian(hypothesis, work.hessian, dt_s, outwards, way.rolls, way.rolled_kept)
    standing_and_rolling_j = vehicle.idle_w * dt_s + rolling(vehicle, 0.0) * way_m
    coasts = _update_with_power(
        prior=prior,
        hypothesis=hypothesis,
        read=reading.power_w * dt_s / vehicle.full_j,
        predicted=energy + mean[OFFSET] * dt_s,
        variance=variance,
        driving=driving,
        residual_variance=way.residual_variance,
        rolls=way.rolls,
        work=work,
        change_probability=change_probability,
        most_load=thresholds.MOST_LOADS * standing_and_rolling_j / vehicle.full_j,
        coasts=coasts,
    )
    _note_rolling(vehicle, robot, reading, hypothesis, places, rollings, way.rolls)
    return coasts


@inline
def _write_cross_covariance(covariance: Any, jacobian: Any, cross_covariance: Any) -> float:
    """Write the covariance of a reading with the states, P J^T, and return its variance, J P
    J^T."""
    variance = 0.0
    for a in range(STATES):
        total = 0.0
        for b in range(STATES):
            total += covariance[a, b] * jacobian[b]
        cross_covariance[a] = total
        variance += jacobian[a] * total
    return variance


@inline
def _add_ground(
    mean: Any, covariance: Any, cross_covariance: Any, rolls: float, tilt_climb: float
) -> None:
    """Add ground that was driven on the way out to that between home and here, as it rolls and
    climbs here."""
    propagate(covariance, ROLLED, 1.0, ROLLING, rolls)
    mean[ROLLED] += rolls * mean[ROLLING]
    cross_covariance[ROLLED] += rolls * cross_covariance[ROLLING]
    propagate(covariance, CLIMB, 1.0, TILT, tilt_climb)
    mean[CLIMB] += tilt_climb * mean[TILT]
    cross_covariance[CLIMB] += tilt_climb * cross_covariance[TILT]


@inline
def _leave_ground(
    mean: Any, covariance: Any, cross_covariance: Any, rolled_kept: float, climb_kept: float
) -> None:
    """Keep a share of the ground between home and here: the rest was driven on the way home."""
    propagate(covariance, ROLLED, rolled_kept, ROLLING, 0.0)
    propagate(covariance, CLIMB, climb_kept, ROLLING, 0.0)
    mean[ROLLED] *= rolled_kept
    mean[CLIMB] *= climb_kept
    cross_covariance[ROLLED] *= rolled_kept
    cross_covariance[CLIMB] *= climb_kept


@inline
def _note_hessian(
    hypothesis: Any, hessian: Any, dt_s: float, outwards: bool, rolls: float, rolled_kept: float
) -> None:
    """Store how the rolling of the ground that was driven depends on the square of the wind that
    was met there."""
    gust_kept = np.exp(-dt_s / hypothesis.gust_s)
    if outwards:
        for a in range(3):
            hypothesis.hessian[0, a] += hessian[a]
            hypothesis.hessian[1, a] = gust_kept * hypothesis.hessian[1, a] + hessian[a]
            hypothesis.hessian_here[0, a] += hessian[a]
            hypothesis.hessian_here[1, a] = gust_kept * hypothesis.hessian_here[1, a] + hessian[a]
        hypothesis.rolls_here += rolls
    else:
        for a in range(3):
            hypothesis.hessian[0, a] *= rolled_kept
            hypothesis.hessian[1, a] *= gust_kept * rolled_kept
            hypothesis.hessian_here[1, a] *= gust_kept


@inline
def _update_with_power(
    prior: Any,
    hypothesis: Any,
    read: float,
    predicted: float,
    variance: float,
    driving: float,
    residual_variance: float,
    rolls: float,
    work: Any,
    change_probability: float,
    most_load: float,
    coasts: float,
) -> float:
    """Update with a reading of energy, over the file's usable energy; returns `coasts`.

    Args:
        prior: `Prior`.
        hypothesis: `HYPOTHESIS_DTYPE`; updated.
        read: The energy that was read; NaN: it was not.
        predicted: Its prediction.
        variance: Variance of the prediction.
        driving: The part of it for driving.
        residual_variance: See `WayEnergy`, like the next one.
        rolls: Rolling by the file.
        work: `Workspace`: its `cross_covariance` and `ground_jump` belong to the reading.
        change_probability: See `kalman_update`, like the next one.
        most_load: Largest energy of a load that the model lacks.
        coasts: Whether the robot coasts; NaN: this hypothesis decides.
    """
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    if not np.isfinite(read):
        add_noise_along(covariance, work.ground_jump, change_probability * prior.patch_sd**2)
        return coasts
    innovation = read - predicted
    variance += (prior.power_noise * read) ** 2
    coasting_energy = thresholds.COASTS * rolls
    if math.isnan(coasts):
        coasts = 0.0
        if innovation + driving < coasting_energy and rolls > 0.0:
            coasts = 1.0
    if coasts == 1.0:
        # All hypotheses use the same decision, as the density of one and the probability of another
        # cannot be compared.
        sd = math.sqrt(2.0 * max(variance, _LEAST_VARIANCE))
        coasting_probability = 0.5 * math.erfc((driving - coasting_energy) / sd)
        hypothesis.log_weight += thresholds.TEMPER * np.log(
            max(coasting_probability, thresholds.LEAST_CHANCE)
        )
        if residual_variance > 0.0:
            # The prediction includes that it may coast: the other states keep their estimates.
            mean[USED] += innovation
            for a in range(STATES):
                if a != USED:
                    covariance[USED, a] = 0.0
                    covariance[a, USED] = 0.0
            return coasts
    east_before_mps = mean[EAST]
    north_before_mps = mean[NORTH]
    gust_east_before_mps = mean[GUST_EAST]
    gust_north_before_mps = mean[GUST_NORTH]
    log_likelihood, normalised_square = kalman_update(
        mean=mean,
        covariance=covariance,
        innovation=innovation,
        variance=variance,
        cross_covariance=work.cross_covariance,
        ground_jump=work.ground_jump,
        change_probability=change_probability,
        change_sd=prior.patch_sd,
        reading=read,
        most_load=most_load,
    )
    if coasts == 0.0:
        hypothesis.log_weight += thresholds.TEMPER * log_likelihood
    # A normalised innovation squared above 1 indicates gusts that change faster.
    surprise = min(normalised_square, thresholds.DOUBT) - 1.0
    gust_s = hypothesis.gust_s * np.exp(-thresholds.ADAPT * surprise)
    hypothesis.gust_s = min(max(gust_s, prior.shortest_gust_s), prior.longest_gust_s)
    wind_change_mps = (mean[EAST] - east_before_mps, mean[NORTH] - north_before_mps)
    gust_change_mps = (
        mean[GUST_EAST] - gust_east_before_mps,
        mean[GUST_NORTH] - gust_north_before_mps,
    )
    per_rolls_here = 1.0 / max(hypothesis.rolls_here, LEAST_ROLLED)
    follow_curve(
        mean, covariance, ROLLED, hypothesis.hessian, 1.0, wind_change_mps, gust_change_mps
    )
    follow_curve(
        mean,
        covariance,
        ROLLING,
        hypothesis.hessian_here,
        per_rolls_here,
        wind_change_mps,
        gust_change_mps,
    )
    # Of new ground it is not known how its rolling depends on the wind.
    for a in range(3):
        hypothesis.hessian_here[0, a] *= 1.0 - change_probability
        hypothesis.hessian_here[1, a] *= 1.0 - change_probability
    hypothesis.rolls_here *= 1.0 - change_probability
    return coasts


@inline
def _predict_gusts(prior: Any, dt_s: float, hypothesis: Any) -> None:
    """Predict the gusts: Ornstein-Uhlenbeck processes that forget with `gust_s`."""
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    gust_kept = np.exp(-dt_s / hypothesis.gust_s)
    variance = gust_variance(prior, mean, covariance)
    for gust in (GUST_EAST, GUST_NORTH):
        mean[gust] *= gust_kept
        for a in range(STATES):
            covariance[gust, a] *= gust_kept
            covariance[a, gust] *= gust_kept
        covariance[gust, gust] += variance * (1.0 - gust_kept * gust_kept)


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
    work: Any,
) -> WayEnergy:
    """Energy since the last reading, place by place.

    Writes its derivatives by each state (`work.jacobian`) and its second ones by the wind
    (`work.hessian`).
    """
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    jacobian = work.jacobian
    hessian = work.hessian
    stretch_jacobian = work.stretch_jacobian
    outwards = reading.position_m >= robot.position_m
    ahead = 1.0 if outwards else -1.0
    reached_m = min(robot.position_m, reading.position_m)
    end_m = max(robot.position_m, reading.position_m)
    speed_mps = _speed(robot, reading, dt_s)
    per_rolled = 1.0 / max(hypothesis.rolled, LEAST_ROLLED)
    climb_per_m = climbing(vehicle, 1.0)

    jacobian[:] = 0.0
    hessian[:] = 0.0
    modelled = 0.0  # energy of driving by the robot's own model
    driving = 0.0
    residual_variance = 0.0
    rolls = 0.0
    rolled_left = 0.0  # share of the ground's rolling between home and here that was driven
    climb_variance = 0.0
    k = place_of(vehicle, reached_m, places)
    while reached_m < end_m:
        border_m = _leaves_place_m(vehicle, k, places, end_m)
        way_m = max(border_m - reached_m, 0.0)
        place = places[k]
        if outwards:
            sine = ahead * place.sine
            rolled = -1.0  # new ground
        else:
            sine = ahead * place.sine_driven
            rolled = rollings[k] * per_rolled
        stretch = Stretch(
            way_m=way_m,
            sine=sine,
            east=ahead * place.east,
            north=ahead * place.north,
            speed_mps=speed_mps,
            rolled=rolled,
            climb_share=way_m / max(robot.position_m, LEAST_WAY_M),
            gust_share=1.0,
        )
        energy, variance = predict(
            vehicle,
            prior,
            mean,
            covariance,
            stretch,
            jacobian,
            hessian,
            stretch_jacobian,
        )
        roll = rolling(vehicle, sine) * way_m / vehicle.full_j
        slope_variance = (
            prior.slope_noise**2 / max(place.readings, 1.0) + prior.slope_within_place**2
        )
        modelled += modelled_driving(vehicle, sine, speed_mps) * way_m / vehicle.full_j
        driving += energy
        residual_variance += variance
        rolls += roll
        rolled_left += rollings[k] * roll * per_rolled
        climb_variance += (climb_per_m * way_m / vehicle.full_j) ** 2 * slope_variance
        reached_m = max(border_m, reached_m)
        k = min(k + 1, len(places) - 1)

    not_driving = (vehicle.idle_w * dt_s + reading.other_j) / vehicle.full_j
    if np.isfinite(reading.modelled_j):
        not_driving = reading.modelled_j / vehicle.full_j - modelled
    jacobian[GAIN] += not_driving
    return WayEnergy(
        driving=driving,
        not_driving=mean[GAIN] * not_driving,
        residual_variance=residual_variance,
        rolls=rolls,
        rolled_kept=max(1.0 - rolled_left, 0.0),
        climb_variance=climb_variance,
    )


@inline
def rolled_from_home(vehicle: Any, position_m: float, places: Any, rollings: Any) -> float:
    """Sum of rolling as it was met over the ground between home and a position, over the file's
    usable energy."""
    total_j = 0.0
    for k in range(place_of(vehicle, position_m, places) + 1):
        way_m = max(min(vehicle.place_m, position_m - k * vehicle.place_m), 0.0)
        total_j += rollings[k] * rolling(vehicle, places[k].sine_driven) * way_m
    return float(total_j / vehicle.full_j)


@inline
def _note_rolling(
    vehicle: Any,
    robot: Any,
    reading: Any,
    hypothesis: Any,
    places: Any,
    rollings: Any,
    rolls: float,
) -> None:
    """Store the rolling resistance by place, as estimated on the way out."""
    if reading.position_m < robot.position_m:
        hypothesis.rolled = rolled_from_home(vehicle, reading.position_m, places, rollings)
        return
    rolling_now = max(hypothesis.mean[ROLLING], thresholds.LEAST_ROLLING)
    reached_m = robot.position_m
    k = place_of(vehicle, reached_m, places)
    while reached_m < reading.position_m:
        border_m = _leaves_place_m(vehicle, k, places, reading.position_m)
        new_m = max(border_m - reached_m, 0.0)
        before_m = max(reached_m - k * vehicle.place_m, 0.0)
        rollings[k] += (rolling_now - rollings[k]) * new_m / max(new_m + before_m, LEAST_WAY_M)
        reached_m = max(border_m, reached_m)
        k = min(k + 1, len(places) - 1)
    hypothesis.rolled += rolling_now * rolls


@inline
def _note_way(vehicle: Any, robot: Any, reading: Any, places: Any) -> None:
    """Store the robot's place, and the slopes that were used for its way out."""
    reached_m = robot.position_m
    k = place_of(vehicle, reached_m, places)
    while reached_m < reading.position_m:
        border_m = _leaves_place_m(vehicle, k, places, reading.position_m)
        new_m = max(border_m - reached_m, 0.0)
        before_m = max(reached_m - k * vehicle.place_m, 0.0)
        place = places[k]
        place.sine_driven += (
            (place.sine - place.sine_driven) * new_m / max(new_m + before_m, LEAST_WAY_M)
        )
        reached_m = max(border_m, reached_m)
        k = min(k + 1, len(places) - 1)
    robot.time_s = reading.time_s
    robot.position_m = reading.position_m


@called
def _update_with_charge(
    prior: Any,
    robot: Any,
    soc: float,
    dt_s: float,
    used: float,
    used_before: float,
    hypotheses: Any,
) -> None:
    """Update with a state of charge: energy used over the capacity.

    Args:
        prior: `Prior`.
        robot: `ROBOT_DTYPE`.
        soc: The reading, 0 to 1.
        dt_s: Time since the last reading, s.
        used: Energy used, the mean of all hypotheses.
        used_before: The same at the last reading.
        hypotheses: `HYPOTHESIS_DTYPE`, shape (hypotheses,).
    """
    _predict_charge(prior, robot, dt_s, used, used_before, hypotheses)
    if not np.isfinite(soc):
        return
    if soc != robot.soc:
        robot.soc = soc
        robot.soc_since = used
    else:
        stuck_by = (
            thresholds.STUCK_STEPS * prior.soc_step
            + thresholds.STUCK_NOISE * prior.soc_noise
            + thresholds.STUCK
        )
        if used - robot.soc_since > stuck_by:
            return
    reading_variance = _charge_variance(prior, robot, used)
    robot.soc_taken = used
    cross_covariance = np.empty(STATES)
    for k in range(len(hypotheses)):
        if hypotheses[k].log_weight > -np.inf:
            _update_hypothesis_with_charge(
                hypotheses[k], robot, soc, reading_variance, cross_covariance
            )


@inline
def _predict_charge(
    prior: Any, robot: Any, dt_s: float, used: float, used_before: float, hypotheses: Any
) -> None:
    """Predict the lag of the state of charge, and its lasting error."""
    # A first-order lag behind what is used at a constant power.
    lag_kept = 0.0
    if prior.soc_lag_s > 0.0:
        lag_kept = np.exp(-dt_s / prior.soc_lag_s)
    per_lag = prior.soc_lag_s / dt_s * (1.0 - lag_kept)
    robot.lag = lag_kept * robot.lag + per_lag * (used - used_before)
    error_kept = np.exp(-abs(used - used_before) / prior.soc_error_lasts)
    for k in range(len(hypotheses)):
        covariance = hypotheses[k].covariance
        propagate(covariance, SOC_ERROR, error_kept, SOC_ERROR, 0.0)
        hypotheses[k].mean[SOC_ERROR] *= error_kept
        covariance[SOC_ERROR, SOC_ERROR] += prior.soc_error**2 * (1.0 - error_kept * error_kept)


@inline
def _charge_variance(prior: Any, robot: Any, used: float) -> float:
    """Variance of a reading of the state of charge: more if its rounding error is that of the
    reading before.

    Rounding errors repeat until noise or consumption changes the reading by a step.
    """
    step = max(prior.soc_step, _LEAST_STEP)
    noise = prior.soc_noise
    rounded_alike = np.exp(-((2.0 * np.pi * noise / step) ** 2)) * max(
        1.0 - abs(used - robot.soc_taken) / step, 0.0
    )
    variance = step * step / 12.0 + noise * noise + thresholds.LEAST_SOC_ERROR**2
    return float(variance / max(1.0 - rounded_alike, thresholds.LEAST_INDEPENDENT))


@inline
def _update_hypothesis_with_charge(
    hypothesis: Any, robot: Any, soc: float, reading_variance: float, cross_covariance: Any
) -> None:
    """Kalman update with the charge since the start, z = x_per_capacity (x_used - lag) -
    x_soc_error."""
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    spent = mean[USED] - robot.lag
    per_capacity = mean[PER_CAPACITY]
    innovation = robot.soc_start - soc - per_capacity * spent + mean[SOC_ERROR]
    for a in range(STATES):
        cross_covariance[a] = (
            spent * covariance[a, PER_CAPACITY]
            + per_capacity * covariance[a, USED]
            - covariance[a, SOC_ERROR]
        )
    predicted_variance = (
        spent * cross_covariance[PER_CAPACITY]
        + per_capacity * cross_covariance[USED]
        - cross_covariance[SOC_ERROR]
    )
    # A reading that is far off counts less.
    variance = max(
        reading_variance + predicted_variance, innovation * innovation / thresholds.DOUBT
    )
    for a in range(STATES):
        mean[a] += cross_covariance[a] * innovation / variance
        for b in range(STATES):
            covariance[a, b] -= cross_covariance[a] * cross_covariance[b] / variance
    hypothesis.log_weight -= 0.5 * (innovation * innovation / variance + np.log(variance))


@inline
def _normalise(hypotheses: Any) -> None:
    """Normalise the weights to a sum of one, with a lower limit for each."""
    largest = -np.inf
    for k in range(len(hypotheses)):
        largest = max(largest, hypotheses[k].log_weight)
    total = 0.0
    for k in range(len(hypotheses)):
        if hypotheses[k].log_weight > -np.inf:
            hypotheses[k].log_weight = max(
                hypotheses[k].log_weight - largest, thresholds.LEAST_LOG_WEIGHT
            )
            total += np.exp(hypotheses[k].log_weight)
    for k in range(len(hypotheses)):
        hypotheses[k].log_weight -= np.log(total)
