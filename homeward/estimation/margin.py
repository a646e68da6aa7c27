"""Margin of a plan: energy left, less that of driving on and then home, as a distribution."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.drive import Stretch, modelled_driving, predict, rolling
from homeward.estimation.filter import place_of
from homeward.estimation.prior import (
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    PER_CAPACITY,
    STATES,
    USED,
)
from homeward.estimation.wind import covariance_of_wind, gust_variance, quadratic_cumulants
from homeward.physics.jit import called, compiled, inline

PLAN_DTYPE = np.dtype(
    [
        ("onwards_m", np.float64),  # to drive on before heading home, negative to drive towards home
        ("speed_mps", np.float64),  # of that
        ("onwards_j", np.float64),  # energy of all but driving meanwhile, by the robot's own model
        ("onwards_s", np.float64),  # duration of that
        ("home_mps", np.float64),  # speed home
        ("home_cost_j", np.float64),  # from here home by the robot's own model at cruise
        ("sine", np.float64),  # of the slope ahead; NaN: as here
        ("knows_ahead", np.float64),  # 1: slopes and directions ahead are those noted for the places there
        ("elsewhere", np.float64),  # 1: home leads by another way than the one out, which `ways` gives
        ("unsure_j", np.float64),  # standard deviation of the plan's energy beyond all that is estimated
    ]
)
"""A plan: drive on, then home."""
WAY_DTYPE = np.dtype([(name, np.float64) for name in ("way_m", "sine", "east", "north", "speed_mps")])
"""A stretch of a way home that is not the way out; slope and direction are those of travel."""
MARGIN_DTYPE = np.dtype(
    [(f"{name}{kind}_j", np.float64) for name in ("left", "cost", "margin") for kind in ("", "_sd")]
    + [("cost_share", np.float64), ("cost_share_sd", np.float64), ("margin_low_j", np.float64)]
)
"""Energy left, energy of a plan and margin, as metered, and their standard deviations; the energy of the plan as a
share of a full battery; and the margin at the given risk."""
_MOST_STEPS = 100  # five or six are enough, unless the probability jumps; chosen: bounds the search
_NEGLIGIBLE = (
    1e-3  # weight of a hypothesis, over the risk, that moves no quantile; chosen: a thousandth of its probability
)
_PRECISELY = 1e-3  # error of a quantile of a sum, over the spread of its parts; chosen: far below a deviation
_EXACTLY = 1e-3  # relative accuracy of a quantile's probability; chosen: far below that of any risk


@compiled
def compute_margins(
    vehicle: Any,
    prior: Any,
    plans: Any,
    ways: Any,
    risk: float,
    normal_quantile: float,
    robots: Any,
    hypotheses: Any,
    places: Any,
    rollings: Any,
    margins: Any,
    mixture: Any,
) -> None:
    """Compute the margins of plans.

    Args:
        vehicle: `Vehicle`.
        prior: `Prior`.
        plans: `PLAN_DTYPE`, shape (n,); one without a way home, NaN, is left out.
        ways: `WAY_DTYPE`, shape (m,): the way home of plans that lead home elsewhere.
        risk: Probability that the margin is below `margin_low_j`; 0 leaves that out, which takes a third of the time.
        normal_quantile: The same quantile of a standard normal distribution.
        robots: See `homeward.estimation.filter`, like the next three.
        hypotheses: Shape (n, hypotheses).
        places: Shape (n, places).
        rollings: Shape (n, hypotheses, places).
        margins: Written, `MARGIN_DTYPE`, shape (n,).
        mixture: Written: weight and mean, standard deviation and skewness (at most 0) of the margin of each hypothesis,
            shape (n, hypotheses, 4).
    """
    jacobian, share_jacobian, stretch_jacobian = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    sums, hessian, wind_covariance = np.zeros((4, 2)), np.zeros(3), np.zeros(3)
    for i in range(len(plans)):
        if np.isnan(plans[i].home_cost_j):
            continue
        sums[:] = 0.0
        for k in range(hypotheses.shape[1]):
            hypothesis = hypotheses[i, k]
            weight = np.exp(hypothesis.log_weight)
            mixture[i, k, :] = 0.0
            if weight == 0.0:
                continue
            cost, variance, gust_share, gust_variance_to_come = _cost(
                vehicle,
                prior,
                robots[i],
                plans[i],
                ways,
                hypothesis,
                places[i],
                rollings[i, k],
                jacobian,
                hessian,
                wind_covariance,
                stretch_jacobian,
            )
            mean, covariance = hypothesis.mean, hypothesis.covariance
            capacity, start = 1.0 / mean[PER_CAPACITY], robots[i].soc_start
            left = start * capacity * (1.0 + covariance[PER_CAPACITY, PER_CAPACITY] * capacity * capacity) - mean[USED]
            for a in range(STATES):
                share_jacobian[a] = jacobian[a] * mean[PER_CAPACITY]
            share_jacobian[PER_CAPACITY] += cost
            _add(sums[0], weight, cost, variance + _quadratic(covariance, jacobian))
            _add(
                sums[1],
                weight,
                cost * mean[PER_CAPACITY],
                variance * mean[PER_CAPACITY] ** 2 + _quadratic(covariance, share_jacobian),
            )
            jacobian[USED] += 1.0
            jacobian[PER_CAPACITY] += start * capacity * capacity
            margin_variance = variance + _quadratic(covariance, jacobian)
            _add(sums[2], weight, left - cost, margin_variance)
            mixture[i, k, 0], mixture[i, k, 1], mixture[i, k, 2] = weight, left - cost, np.sqrt(margin_variance)
            # A tail lighter than a normal distribution's is not used.
            longer = max(
                _third_cumulant(covariance, jacobian, hessian, wind_covariance, gust_share, gust_variance_to_come), 0.0
            )
            mixture[i, k, 3] = -longer / max(margin_variance, 1e-18) ** 1.5
            jacobian[:] = 0.0
            jacobian[USED], jacobian[PER_CAPACITY] = 1.0, start * capacity * capacity
            _add(sums[3], weight, left, _quadratic(covariance, jacobian))
        margin = margins[i]
        margin.cost_j, margin.cost_sd_j = vehicle.full_j * sums[0, 0], vehicle.full_j * _deviation(sums[0])
        margin.cost_share, margin.cost_share_sd = sums[1, 0], _deviation(sums[1])
        margin.margin_j, margin.margin_sd_j = vehicle.full_j * sums[2, 0], vehicle.full_j * _deviation(sums[2])
        margin.left_j, margin.left_sd_j = vehicle.full_j * sums[3, 0], vehicle.full_j * _deviation(sums[3])
        margin.margin_low_j = vehicle.full_j * _quantile(mixture[i], risk, normal_quantile) if risk > 0.0 else np.nan
        for k in range(hypotheses.shape[1]):
            mixture[i, k, 1] *= vehicle.full_j
            mixture[i, k, 2] *= vehicle.full_j


@inline
def _add(sums: Any, weight: float, mean: float, variance: float) -> None:
    sums[0] += weight * mean
    sums[1] += weight * (variance + mean * mean)


@inline
def _deviation(sums: Any) -> float:
    return float(np.sqrt(max(sums[1] - sums[0] * sums[0], 0.0)))


@inline
def _quadratic(covariance: Any, jacobian: Any) -> float:
    total = 0.0
    for a in range(STATES):
        for b in range(STATES):
            total += jacobian[a] * covariance[a, b] * jacobian[b]
    return max(total, 0.0)


@inline
def _third_cumulant(
    covariance: Any, jacobian: Any, hessian: Any, wind_covariance: Any, gust_share: float, gust_variance_to_come: float
) -> float:
    """Third cumulant of the energy: winds above their expectation add to its tail.

    Args:
        covariance: Covariance of the states.
        jacobian: Derivative of the energy by each state.
        hessian: Second derivatives by the wind.
        wind_covariance: Covariance of the wind on the way.
        gust_share: See `covariance_of_wind`, like the next one.
        gust_variance_to_come: Variance.
    """
    # Covariance of the wind with the energy, as far as that is linear.
    east, north = jacobian[EAST] * gust_variance_to_come, jacobian[NORTH] * gust_variance_to_come
    for a in range(STATES):
        east += jacobian[a] * (covariance[a, EAST] + gust_share * covariance[a, GUST_EAST])
        north += jacobian[a] * (covariance[a, NORTH] + gust_share * covariance[a, GUST_NORTH])
    _, _, cubes = quadratic_cumulants(hessian, wind_covariance)
    return float(
        3.0 * (hessian[0] * east * east + 2.0 * hessian[1] * east * north + hessian[2] * north * north) + cubes
    )


@inline
def _below(normal_quantile: float, skewness: float) -> float:
    """Probability that a number of given skewness is below `normal_quantile` standard deviations above its mean.

    As in a Pearson type III distribution, by Wilson and Hilferty's cube root (Proceedings of the National Academy of
    Sciences 17, 1931).
    """
    return 0.5 * math.erfc(-_standardised(normal_quantile, skewness) / math.sqrt(2.0))


@inline
def _standardised(normal_quantile: float, skewness: float) -> float:
    """Standard deviations at which a number without skewness has the same probability, see `_below`."""
    if abs(skewness) > thresholds.LEAST_SKEWNESS:
        return float(
            6.0 / skewness * (np.cbrt(max(1.0 + 0.5 * skewness * normal_quantile, 0.0)) - 1.0) + skewness / 6.0
        )
    return normal_quantile


@inline
def _deviations(normal_quantile: float, skewness: float) -> float:
    """The inverse of `_below`, for the probability that a normal distribution has below `normal_quantile`."""
    if abs(skewness) > thresholds.LEAST_SKEWNESS:
        return float(2.0 / skewness * (max(1.0 + skewness / 6.0 * (normal_quantile - skewness / 6.0), 0.0) ** 3 - 1.0))
    return normal_quantile


@called
def _quantile(mixture: Any, risk: float, normal_quantile: float) -> float:
    """Quantile of a mixture of distributions of given mean, deviation and skewness.

    It lies between the quantiles of its parts, and is found there by the Illinois method (Dowell and Jarratt, BIT 11,
    1971).

    Args:
        mixture: Weight, mean, standard deviation and skewness of each part, shape (n, 4).
        risk: The probability.
        normal_quantile: The same quantile of a normal distribution.
    """
    low, high = np.inf, -np.inf
    for k in range(len(mixture)):
        if mixture[k, 0] > 0.0:
            own = mixture[k, 1] + mixture[k, 2] * _deviations(normal_quantile, mixture[k, 3])
            low, high = min(low, own), max(high, own)
    below, above = _log_below(mixture, low) - np.log(risk), _log_below(mixture, high) - np.log(risk)
    if above < _EXACTLY:
        return high
    if below > -_EXACTLY:
        return low
    was = 0.0
    for _ in range(_MOST_STEPS):
        value = (low * above - high * below) / (above - below)
        off = _log_below(mixture, value) - np.log(risk)
        if abs(off) <= _EXACTLY:
            return float(value)
        # An end that stays twice counts half.
        if off < 0.0:
            low, below, above = value, off, 0.5 * above if was < 0.0 else above
        else:
            high, above, below = value, off, 0.5 * below if was > 0.0 else below
        was = off
    return low


@compiled
def chance_below(mixture: Any, totals: Any, weights: Any, value: float, least: float) -> float:
    """Probability that the sum of two independent numbers is below a value.

    Args:
        mixture: The first, a mixture: weight, mean, standard deviation and skewness of each part, shape (n, 4). Its
            tails are those of Student's t (`homeward.estimation.tails`).
        totals: Values of the second, shape (m,).
        weights: Their probabilities, shape (m,).
        value: The value.
        least: Weight up to which a part of the first is left out.
    """
    below = 0.0
    for k in range(len(mixture)):
        if mixture[k, 0] > least:
            for margin in range(len(totals)):
                normal_quantile = (value - mixture[k, 1] - totals[margin]) / max(mixture[k, 2], 1e-300)
                below += (
                    mixture[k, 0] * weights[margin] * _below_by_student(_standardised(normal_quantile, mixture[k, 3]))
                )
    return float(below)


@compiled
def quantile_of_sum(mixture: Any, totals: Any, weights: Any, risk: float, student_quantile: float) -> float:
    """Value below which the sum of `chance_below` is with a probability of `risk`.

    It lies between those of the sum's parts, and is found there by bisection. `student_quantile`: that of Student's t.
    """
    low, high, negligible = np.inf, -np.inf, _NEGLIGIBLE * risk
    for k in range(len(mixture)):
        if mixture[k, 0] > negligible:
            own = mixture[k, 1] + mixture[k, 2] * _deviations(student_quantile, mixture[k, 3])
            low, high = min(low, own + totals[0]), max(high, own + totals[-1])
    least = _PRECISELY * max(high - low, 0.0)
    while high - low > least:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break  # neighbouring numbers: nothing is between them
        if chance_below(mixture, totals, weights, middle, negligible) > risk:
            high = middle
        else:
            low = middle
    return float(low)


@inline
def _below_by_student(normal_quantile: float) -> float:
    """Probability that a number of Student's t with seven degrees of freedom is below `normal_quantile`.

    In closed form, as for all odd numbers of them (Abramowitz and Stegun, 26.7.3).
    """
    angle = math.atan2(normal_quantile, math.sqrt(thresholds.DEGREES))
    cosine = math.cos(angle)
    square = cosine * cosine
    series = cosine * (1.0 + square * (2.0 / 3.0 + square * (8.0 / 15.0)))
    return 0.5 + (angle + math.sin(angle) * series) / math.pi


@inline
def _log_below(mixture: Any, value: float) -> float:
    """Logarithm of the probability of such a mixture below a value."""
    below = 0.0
    for k in range(len(mixture)):
        if mixture[k, 0] > 0.0:
            below += mixture[k, 0] * _below((value - mixture[k, 1]) / max(mixture[k, 2], 1e-300), mixture[k, 3])
    return float(np.log(max(below, 1e-300)))


@called
def _cost(
    vehicle: Any,
    prior: Any,
    robot: Any,
    plan: Any,
    ways: Any,
    hypothesis: Any,
    places: Any,
    rollings: Any,
    jacobian: Any,
    hessian: Any,
    wind_covariance: Any,
    stretch_jacobian: Any,
) -> tuple[float, float, float, float]:
    """Energy of a plan by a hypothesis.

    Writes its derivatives by each state (`jacobian`), its second derivatives by the wind (`hessian`) and the covariance
    of the wind on the way (`wind_covariance`), both east, both and north.

    Returns:
        The energy; its variance beyond that of the states; share of the present gusts that remains on the way; variance
        of either component of the gusts to come.
    """
    mean, covariance = hypothesis.mean, hypothesis.covariance
    here_m = robot.position_m
    turn_m = max(here_m + plan.onwards_m, 0.0)
    # Of the present gusts a part remains on average; of those to come, an average over the way counts.
    home_s = (
        _duration_s(ways) + max(plan.onwards_m, 0.0) / plan.home_mps if plan.elsewhere > 0.0 else turn_m / plan.home_mps
    )
    course = max((plan.onwards_s + home_s) / hypothesis.gust_s, 1e-6)
    gust_share = (1.0 - np.exp(-course)) / course
    gusts = gust_variance(prior, mean, covariance)
    jacobian[:], hessian[:] = 0.0, 0.0
    cost = variance = own = 0.0
    last = place_of(vehicle, here_m, places)
    for k in range(last + 1 if plan.elsewhere == 0.0 else 0):
        start_m, end_m = k * vehicle.place_m, here_m if k == last else (k + 1) * vehicle.place_m
        border_m = min(max(turn_m, start_m), end_m)  # beyond it, it drives home already before it heads home
        place = places[k]
        own += modelled_driving(vehicle, -place.sine_driven, vehicle.cruise_mps) * (end_m - start_m)
        met = rollings[k] / max(hypothesis.rolled, 1e-12)
        for way_m, speed_mps in ((border_m - start_m, plan.home_mps), (end_m - border_m, plan.speed_mps)):
            if way_m > 0.0:
                sine, east, north = -place.sine_driven, -place.east, -place.north
                stretch = Stretch(way_m, sine, east, north, speed_mps, met, way_m / here_m, gust_share)
                energy, residual_variance = predict(
                    vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
                )
                cost += energy
                variance += residual_variance
    # The rolling of the ground depends on the wind as the way home does: on average the two cancel.
    home_share = min(turn_m / max(here_m, 1e-9), 1.0) if plan.elsewhere == 0.0 else 0.0
    new_m = 0.0
    if plan.elsewhere > 0.0:
        for way in ways:
            own += modelled_driving(vehicle, way.sine, vehicle.cruise_mps) * way.way_m
            stretch = Stretch(way.way_m, way.sine, way.east, way.north, way.speed_mps, -1.0, 0.0, gust_share)
            energy, residual_variance = predict(
                vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
            )
            cost += energy
            variance += residual_variance
            new_m += 0.5 * way.way_m
    k, reached_m = last, here_m
    while reached_m < turn_m:
        border_m = turn_m
        if plan.knows_ahead > 0.0 and k < len(places) - 1:
            border_m = min((k + 1) * vehicle.place_m, turn_m)
        place, way_m = places[k], max(border_m - reached_m, 0.0)
        sine = plan.sine if plan.knows_ahead == 0.0 and np.isfinite(plan.sine) else place.sine
        for ahead, speed_mps in ((1.0, plan.speed_mps), (-1.0, plan.home_mps)):
            stretch = Stretch(
                way_m, ahead * sine, ahead * place.east, ahead * place.north, speed_mps, -1.0, 0.0, gust_share
            )
            energy, residual_variance = predict(
                vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
            )
            cost += energy
            variance += residual_variance
        reached_m, k = max(border_m, reached_m), min(k + 1, len(places) - 1)
    new_m += max(turn_m - here_m, 0.0)
    if new_m > 0.0:
        # New ground: its rolling resistance may differ, out and home.
        change = 1.0 - np.exp(-new_m / prior.patch_m)
        variance += change * (2.0 * prior.patch_sd * rolling(vehicle, 0.0) * new_m / vehicle.full_j) ** 2
    # Mean additional energy of possible winds and gusts to come, beyond the mean wind.
    gusty = 0.5 * gusts * (hessian[0] + hessian[2])
    for a in range(3):
        hessian[a] -= home_share * hypothesis.hessian[0, a]
    cost += gusty + 0.5 * (
        hessian[0] * covariance[EAST, EAST]
        + 2.0 * hessian[1] * covariance[EAST, NORTH]
        + hessian[2] * covariance[NORTH, NORTH]
    )
    gust_variance_to_come = max(2.0 / course * (1.0 - gust_share) - gust_share * gust_share, 0.0) * gusts
    wind_covariance[0], wind_covariance[1], wind_covariance[2] = covariance_of_wind(
        covariance, gust_share, gust_variance_to_come
    )
    variance += quadratic_cumulants(hessian, wind_covariance)[1]
    # All but driving: the model's way home at cruise, and the energy of electronics at another speed.
    if plan.elsewhere > 0.0:
        rest_j = max(plan.home_cost_j - own, 0.0) + plan.onwards_j
        rest_j += vehicle.idle_w * max(plan.onwards_m, 0.0) / plan.home_mps
    else:
        rest_j = max(plan.home_cost_j - own, 0.0) * home_share + plan.onwards_j
        rest_j += vehicle.idle_w * (turn_m / plan.home_mps - min(turn_m, here_m) / vehicle.cruise_mps)
    jacobian[GAIN] += rest_j / vehicle.full_j
    cost += mean[GAIN] * rest_j / vehicle.full_j
    variance += (jacobian[EAST] ** 2 + jacobian[NORTH] ** 2) * gust_variance_to_come
    return (
        cost,
        variance + (prior.model_error * cost) ** 2 + (plan.unsure_j / vehicle.full_j) ** 2,
        gust_share,
        gust_variance_to_come,
    )


@inline
def _duration_s(ways: Any) -> float:
    """Duration of a way, s."""
    total = 0.0
    for way in ways:
        total += way.way_m / way.speed_mps
    return total
