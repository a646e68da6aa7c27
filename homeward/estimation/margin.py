"""Margin of a plan: energy left, less that of driving on and then home, as a distribution."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.drive import (
    LEAST_ROLLED,
    LEAST_WAY_M,
    Stretch,
    modelled_driving,
    predict,
    rolling,
)
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
        # to drive on before heading home, negative to drive towards home
        ("onwards_m", np.float64),
        ("speed_mps", np.float64),  # of that
        ("onwards_j", np.float64),  # energy of all but driving meanwhile, by the robot's own model
        ("onwards_s", np.float64),  # duration of that
        ("home_mps", np.float64),  # speed home
        ("home_cost_j", np.float64),  # from here home by the robot's own model at cruise
        ("sine", np.float64),  # of the slope ahead; NaN: as here
        # 1: slopes and directions ahead are those noted for the places there
        ("knows_ahead", np.float64),
        # 1: home leads by another way than the one out, which `ways` gives
        ("elsewhere", np.float64),
        # standard deviation of the plan's energy beyond all that is estimated
        ("unsure_j", np.float64),
    ]
)
"""A plan: drive on, then home."""
WAY_DTYPE = np.dtype(
    [(name, np.float64) for name in ("way_m", "sine", "east", "north", "speed_mps")]
)
"""A stretch of a way home that is not the way out; slope and direction are those of travel."""
MARGIN_DTYPE = np.dtype(
    [(f"{name}{kind}_j", np.float64) for name in ("left", "cost", "margin") for kind in ("", "_sd")]
    + [("cost_share", np.float64), ("cost_share_sd", np.float64), ("margin_low_j", np.float64)]
)
"""Energy left, energy of a plan and margin, as metered, and their standard deviations; the energy
of the plan as a share of a full battery; and the margin at the given risk."""
_WEIGHT, _MEAN, _SD, _SKEWNESS = range(4)
"""Columns of a mixture: a row is a distribution and its weight."""
_COST, _COST_SHARE, _MARGIN, _LEFT = range(4)
"""What moments are summed of, over the hypotheses."""
_MOST_STEPS = 100  # five or six are enough, unless the probability jumps; chosen: bounds the search
_NEGLIGIBLE = 1e-3
"""Weight of a hypothesis, over the risk, that moves no quantile. Chosen: a thousandth of its
probability."""
# error of a quantile of a sum, over the spread of its parts; chosen: far below a deviation
_PRECISELY = 1e-3
_EXACTLY = 1e-3  # relative accuracy of a quantile's probability; chosen: far below that of any risk
_LEAST_VARIANCE = 1e-18
"""Least variance of a margin, of a battery squared. Chosen: above 0, because it divides."""
_TINY = 1e-300
"""Least probability and deviation, of which the logarithm and the inverse are finite."""
_FARTHEST = 1e150  # standard deviations; chosen: beyond any, and the square is finite
_LEAST_COURSE = 1e-6
"""Least duration of a way, over the correlation time of the gusts. Chosen: above 0, because it
divides."""


class PlanWorkspace(NamedTuple):
    """Arrays that a margin writes and then reads: made once for all robots, as to allocate in a
    loop is slow."""

    jacobian: Any  # derivative of the energy of a plan by each state, shape (STATES,)
    share_jacobian: Any  # the same of that energy as a share of a full battery
    stretch_jacobian: Any  # the same of the energy of a stretch
    hessian: Any  # second derivatives of the energy by the wind: east, both, north
    wind_covariance: Any  # covariance of the wind on the way, likewise


class PlanCost(NamedTuple):
    """Energy of a plan by a hypothesis, over the file's usable energy."""

    energy: float
    variance: float  # beyond that of the states
    gust_share: float  # share of the present gusts that remains on the way
    gust_variance_to_come: float  # of either component of the gusts to come, (m/s)^2


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
    mixtures: Any,
) -> None:
    """Compute the margins of plans.

    Args:
        vehicle: `Vehicle`.
        prior: `Prior`.
        plans: `PLAN_DTYPE`, shape (n,); one without a way home, NaN, is left out.
        ways: `WAY_DTYPE`, shape (m,): the way home of plans that lead home elsewhere.
        risk: Probability that the margin is below `margin_low_j`; 0 leaves that out, which takes a
            third of the time.
        normal_quantile: The same quantile of a standard normal distribution.
        robots: See `homeward.estimation.filter`, like the next three.
        hypotheses: Shape (n, hypotheses).
        places: Shape (n, places).
        rollings: Shape (n, hypotheses, places).
        margins: Written, `MARGIN_DTYPE`, shape (n,).
        mixtures: Written: weight and mean, standard deviation and skewness (at most 0) of the
            margin of each hypothesis, shape (n, hypotheses, 4).
    """
    work = PlanWorkspace(
        jacobian=np.zeros(STATES),
        share_jacobian=np.zeros(STATES),
        stretch_jacobian=np.zeros(STATES),
        hessian=np.zeros(3),
        wind_covariance=np.zeros(3),
    )
    moments = np.zeros((4, 2))
    full_j = vehicle.full_j
    for i in range(len(plans)):
        if np.isnan(plans[i].home_cost_j):
            continue
        moments[:] = 0.0
        mixture = mixtures[i]
        mixture[:] = 0.0
        for k in range(hypotheses.shape[1]):
            weight = np.exp(hypotheses[i, k].log_weight)
            if weight > 0.0:
                _add_hypothesis(
                    vehicle,
                    prior,
                    robots[i],
                    plans[i],
                    ways,
                    hypotheses[i, k],
                    weight,
                    places[i],
                    rollings[i, k],
                    work,
                    moments,
                    mixture[k],
                )
        margin = margins[i]
        margin.cost_j = full_j * moments[_COST, 0]
        margin.cost_sd_j = full_j * _deviation(moments[_COST])
        margin.cost_share = moments[_COST_SHARE, 0]
        margin.cost_share_sd = _deviation(moments[_COST_SHARE])
        margin.margin_j = full_j * moments[_MARGIN, 0]
        margin.margin_sd_j = full_j * _deviation(moments[_MARGIN])
        margin.left_j = full_j * moments[_LEFT, 0]
        margin.left_sd_j = full_j * _deviation(moments[_LEFT])
        margin.margin_low_j = np.nan
        if risk > 0.0:
            margin.margin_low_j = full_j * _quantile(mixture, risk, normal_quantile)
        for k in range(hypotheses.shape[1]):
            mixture[k, _MEAN] *= full_j
            mixture[k, _SD] *= full_j


@inline
def _add_hypothesis(
    vehicle: Any,
    prior: Any,
    robot: Any,
    plan: Any,
    ways: Any,
    hypothesis: Any,
    weight: float,
    places: Any,
    rollings: Any,
    work: Any,
    moments: Any,
    part: Any,
) -> None:
    """Add the margin of a hypothesis to the moments over all, and write its distribution.

    With the energy E of the plan, the energy used u, and the inverse c of the battery's capacity,
    over the file's usable energy:

        left    L = start / c - u, on average start / c (1 + var(c) / c^2) - u to second order in c
        margin  M = L - E, whose derivatives are those of E and of start / c and u, with the
        opposite sign share   E c, of a full battery

    Args:
        vehicle: `Vehicle`.
        prior: `Prior`.
        robot: `ROBOT_DTYPE`.
        plan: `PLAN_DTYPE`.
        ways: `WAY_DTYPE`, shape (m,).
        hypothesis: `HYPOTHESIS_DTYPE`.
        weight: Its probability.
        places: `PLACE_DTYPE`, shape (places,).
        rollings: Rolling resistance over the file's where it was met, shape (places,).
        work: `PlanWorkspace`; written.
        moments: Weighted sums of values and of their squares, shape (4, 2); added to.
        part: Row of the mixture; written.
    """
    jacobian = work.jacobian
    share_jacobian = work.share_jacobian
    hessian = work.hessian
    wind_covariance = work.wind_covariance
    cost = _cost(
        vehicle,
        prior,
        robot,
        plan,
        ways,
        hypothesis,
        places,
        rollings,
        jacobian,
        hessian,
        work.stretch_jacobian,
        wind_covariance,
    )
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    per_capacity = mean[PER_CAPACITY]
    capacity = 1.0 / per_capacity
    start = robot.soc_start
    energy_left = (
        start * capacity * (1.0 + covariance[PER_CAPACITY, PER_CAPACITY] * capacity * capacity)
        - mean[USED]
    )
    left_by_per_capacity = start * capacity * capacity  # with the opposite sign

    for a in range(STATES):
        share_jacobian[a] = jacobian[a] * per_capacity
    share_jacobian[PER_CAPACITY] += cost.energy
    cost_variance = cost.variance + _quadratic(covariance, jacobian)
    share_variance = cost.variance * per_capacity**2 + _quadratic(covariance, share_jacobian)
    _add_moments(moments[_COST], weight, cost.energy, cost_variance)
    _add_moments(moments[_COST_SHARE], weight, cost.energy * per_capacity, share_variance)

    jacobian[USED] += 1.0
    jacobian[PER_CAPACITY] += left_by_per_capacity
    margin_variance = cost.variance + _quadratic(covariance, jacobian)
    _add_moments(moments[_MARGIN], weight, energy_left - cost.energy, margin_variance)
    third_cumulant = _third_cumulant(
        covariance, jacobian, hessian, wind_covariance, cost.gust_share, cost.gust_variance_to_come
    )
    part[_WEIGHT] = weight
    part[_MEAN] = energy_left - cost.energy
    part[_SD] = np.sqrt(margin_variance)
    # A tail lighter than a normal distribution's is not used.
    part[_SKEWNESS] = -max(third_cumulant, 0.0) / max(margin_variance, _LEAST_VARIANCE) ** 1.5

    jacobian[:] = 0.0
    jacobian[USED] = 1.0
    jacobian[PER_CAPACITY] = left_by_per_capacity
    _add_moments(moments[_LEFT], weight, energy_left, _quadratic(covariance, jacobian))


@inline
def _add_moments(moments: Any, weight: float, mean: float, variance: float) -> None:
    """Add a weighted value and its square to their sums."""
    moments[0] += weight * mean
    moments[1] += weight * (variance + mean * mean)


@inline
def _deviation(moments: Any) -> float:
    """Standard deviation by the mean of a value and of its square."""
    return float(np.sqrt(max(moments[1] - moments[0] * moments[0], 0.0)))


@inline
def _quadratic(covariance: Any, jacobian: Any) -> float:
    """Variance of what is linear in the states, J P J^T."""
    total = 0.0
    for a in range(STATES):
        for b in range(STATES):
            total += jacobian[a] * covariance[a, b] * jacobian[b]
    return max(total, 0.0)


@inline
def _third_cumulant(
    covariance: Any,
    jacobian: Any,
    hessian: Any,
    wind_covariance: Any,
    gust_share: float,
    gust_variance_to_come: float,
) -> float:
    """Third cumulant of the energy: winds above their expectation add to its tail.

    Of a linear part and half of w^T H w it is 3 s^T H s + tr((H W)^3), with the covariance s of the
    wind w with the linear part.

    Args:
        covariance: Covariance of the states.
        jacobian: Derivative of the energy by each state.
        hessian: Second derivatives H by the wind.
        wind_covariance: Covariance W of the wind on the way.
        gust_share: See `covariance_of_wind`, like the next one.
        gust_variance_to_come: Variance.
    """
    east = jacobian[EAST] * gust_variance_to_come
    north = jacobian[NORTH] * gust_variance_to_come
    for a in range(STATES):
        east += jacobian[a] * (covariance[a, EAST] + gust_share * covariance[a, GUST_EAST])
        north += jacobian[a] * (covariance[a, NORTH] + gust_share * covariance[a, GUST_NORTH])
    mixed = hessian[0] * east * east + 2.0 * hessian[1] * east * north + hessian[2] * north * north
    _, _, of_wind = quadratic_cumulants(hessian, wind_covariance)
    return float(3.0 * mixed + of_wind)


@inline
def _below(deviations: float, skewness: float) -> float:
    """Probability that a number of given skewness is below so many standard deviations above its
    mean.

    As in a Pearson type III distribution, by Wilson and Hilferty's cube root (Proceedings of the
    National Academy of Sciences 17, 1931).
    """
    return 0.5 * math.erfc(-_standardised(deviations, skewness) / math.sqrt(2.0))


@inline
def _standardised(deviations: float, skewness: float) -> float:
    """Standard deviations at which a number without skewness has the same probability, see
    `_below`."""
    if abs(skewness) > thresholds.LEAST_SKEWNESS:
        cube_root = np.cbrt(max(1.0 + 0.5 * skewness * deviations, 0.0))
        return float(6.0 / skewness * (cube_root - 1.0) + skewness / 6.0)
    return deviations


@inline
def _deviations(normal_quantile: float, skewness: float) -> float:
    """The inverse of `_below`, for the probability that a normal distribution has below its
    quantile."""
    if abs(skewness) > thresholds.LEAST_SKEWNESS:
        cube_root = max(1.0 + skewness / 6.0 * (normal_quantile - skewness / 6.0), 0.0)
        return float(2.0 / skewness * (cube_root**3 - 1.0))
    return normal_quantile


@called
def _quantile(mixture: Any, risk: float, normal_quantile: float) -> float:
    """Quantile of a mixture of distributions of given mean, deviation and skewness.

    It lies between the quantiles of its parts, and is found there by the Illinois method (Dowell
    and Jarratt, BIT 11, 1971): a root of the logarithm of the probability over the risk.

    Args:
        mixture: Weight, mean, standard deviation and skewness of each part, shape (n, 4).
        risk: The probability.
        normal_quantile: The same quantile of a normal distribution.
    """
    low = np.inf
    high = -np.inf
    for k in range(len(mixture)):
        if mixture[k, _WEIGHT] > 0.0:
            quantile = mixture[k, _MEAN] + mixture[k, _SD] * _deviations(
                normal_quantile, mixture[k, _SKEWNESS]
            )
            low = min(low, quantile)
            high = max(high, quantile)
    low_error = _log_below(mixture, low) - np.log(risk)
    high_error = _log_below(mixture, high) - np.log(risk)
    if high_error < _EXACTLY:
        return high
    if low_error > -_EXACTLY:
        return low
    error_before = 0.0
    for _ in range(_MOST_STEPS):
        value = (low * high_error - high * low_error) / (high_error - low_error)
        error = _log_below(mixture, value) - np.log(risk)
        if abs(error) <= _EXACTLY:
            return float(value)
        # An end that stays twice counts half.
        if error < 0.0:
            low = value
            low_error = error
            if error_before < 0.0:
                high_error *= 0.5
        else:
            high = value
            high_error = error
            if error_before > 0.0:
                low_error *= 0.5
        error_before = error
    return low


@called
def _sum_below(
    mixture: Any, totals: Any, weights: Any, value: float, negligible: float, enough: float
) -> float:
    """Probability of `chance_below`, summed until it is above `enough`."""
    below = 0.0
    for k in range(len(mixture)):
        if mixture[k, _WEIGHT] > negligible:
            for m in range(len(totals)):
                deviations = (value - mixture[k, _MEAN] - totals[m]) / max(mixture[k, _SD], _TINY)
                standardised = _standardised(deviations, mixture[k, _SKEWNESS])
                below += mixture[k, _WEIGHT] * weights[m] * _below_by_student(standardised)
            if below > enough:
                break
    return below


@compiled
def chance_below(mixture: Any, totals: Any, weights: Any, value: float, negligible: float) -> float:
    """Probability that the sum of two independent numbers is below a value.

    Args:
        mixture: The first: weight, mean, standard deviation and skewness of each part, shape (n,
            4). Its tails are those of Student's t (`homeward.estimation.tails`).
        totals: Values of the second, shape (m,).
        weights: Their probabilities, shape (m,).
        value: The value.
        negligible: Weight up to which a part of the first is left out.
    """
    return float(_sum_below(mixture, totals, weights, value, negligible, np.inf))


@compiled
def quantile_of_sum(
    mixture: Any, totals: Any, weights: Any, risk: float, student_quantile: float
) -> float:
    """Value below which the sum of `chance_below` is with a probability of `risk`.

    It lies between those of the sum's parts, and is found there by bisection. `student_quantile`:
    that of Student's t.
    """
    low = np.inf
    high = -np.inf
    negligible = _NEGLIGIBLE * risk
    for k in range(len(mixture)):
        if mixture[k, _WEIGHT] > negligible:
            quantile = mixture[k, _MEAN] + mixture[k, _SD] * _deviations(
                student_quantile, mixture[k, _SKEWNESS]
            )
            low = min(low, quantile + totals[0])
            high = max(high, quantile + totals[-1])
    tolerance = _PRECISELY * max(high - low, 0.0)
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break  # neighbouring numbers: nothing is between them
        if _sum_below(mixture, totals, weights, middle, negligible, risk) > risk:
            high = middle
        else:
            low = middle
    return float(low)


@inline
def _below_by_student(deviations: float) -> float:
    """Probability that a number of Student's t with seven degrees of freedom is below `deviations`.

    In closed form, as for all odd numbers of them (Abramowitz and Stegun, 26.7.3).
    """
    tangent = min(max(deviations, -_FARTHEST), _FARTHEST) / math.sqrt(thresholds.DEGREES)
    square = 1.0 / (1.0 + tangent * tangent)  # of the cosine
    series = square * (1.0 + square * (2.0 / 3.0 + square * (8.0 / 15.0)))
    return 0.5 + (math.atan(tangent) + tangent * series) / math.pi


@inline
def _log_below(mixture: Any, value: float) -> float:
    """Logarithm of the probability of a mixture below a value."""
    below = 0.0
    for k in range(len(mixture)):
        if mixture[k, _WEIGHT] > 0.0:
            deviations = (value - mixture[k, _MEAN]) / max(mixture[k, _SD], _TINY)
            below += mixture[k, _WEIGHT] * _below(deviations, mixture[k, _SKEWNESS])
    return float(np.log(max(below, _TINY)))


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
    stretch_jacobian: Any,
    wind_covariance: Any,
) -> PlanCost:
    """Energy of a plan by a hypothesis.

    With the Jacobian J and the Hessian H of driving, the covariance W of the wind on the way and
    the variance g of either component of its gusts to come:

        E    = driving(x) + tr(H P_wind) / 2 + g tr(H) / 2 + gain rest
        var  = of truncation + new ground + tr((H W)^2) / 2 + g (J_east^2 + J_north^2) + (model
        error E)^2 + unsure^2

    Writes J (`jacobian`), H (`hessian`) and W (`wind_covariance`).
    """
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    here_m = robot.position_m
    turn_m = max(here_m + plan.onwards_m, 0.0)
    onwards_m = max(plan.onwards_m, 0.0)
    leads_elsewhere = plan.elsewhere > 0.0
    home_s = turn_m / plan.home_mps
    if leads_elsewhere:
        home_s = _duration_s(ways) + onwards_m / plan.home_mps
    # Of the present gusts a part remains on average; of those to come, an average over the way
    # counts.
    course = max((plan.onwards_s + home_s) / hypothesis.gust_s, _LEAST_COURSE)
    gust_share = (1.0 - np.exp(-course)) / course
    present_gust_variance = gust_variance(prior, mean, covariance)
    average_share = max(2.0 / course * (1.0 - gust_share) - gust_share * gust_share, 0.0)
    gust_variance_to_come = average_share * present_gust_variance

    jacobian[:] = 0.0
    hessian[:] = 0.0
    new_m = 0.0
    home_share = 0.0  # share of the ground between home and here that the way home crosses
    if leads_elsewhere:
        modelled_j, energy, variance = _other_way_home(
            vehicle, prior, ways, hypothesis, gust_share, jacobian, hessian, stretch_jacobian
        )
        for way in ways:
            new_m += 0.5 * way.way_m
    else:
        modelled_j, energy, variance = _way_back(
            vehicle,
            prior,
            robot,
            plan,
            turn_m,
            hypothesis,
            places,
            rollings,
            gust_share,
            jacobian,
            hessian,
            stretch_jacobian,
        )
        home_share = min(turn_m / max(here_m, LEAST_WAY_M), 1.0)
    energy, variance = _add_onwards(
        vehicle,
        prior,
        robot,
        plan,
        turn_m,
        hypothesis,
        places,
        gust_share,
        jacobian,
        hessian,
        stretch_jacobian,
        energy,
        variance,
    )
    new_m += max(turn_m - here_m, 0.0)
    if new_m > 0.0:
        # New ground: its rolling resistance may differ, out and home.
        change_probability = 1.0 - np.exp(-new_m / prior.patch_m)
        change_sd = 2.0 * prior.patch_sd * rolling(vehicle, 0.0) * new_m / vehicle.full_j
        variance += change_probability * change_sd**2

    # Mean additional energy of possible winds and gusts to come, beyond the mean wind.
    of_gusts = 0.5 * present_gust_variance * (hessian[0] + hessian[2])
    # The rolling of the ground depends on the wind as the way home does: on average the two cancel.
    for a in range(3):
        hessian[a] -= home_share * hypothesis.hessian[0, a]
    of_mean_wind = 0.5 * (
        hessian[0] * covariance[EAST, EAST]
        + 2.0 * hessian[1] * covariance[EAST, NORTH]
        + hessian[2] * covariance[NORTH, NORTH]
    )
    energy += of_gusts + of_mean_wind
    east, east_north, north = covariance_of_wind(covariance, gust_share, gust_variance_to_come)
    wind_covariance[0] = east
    wind_covariance[1] = east_north
    wind_covariance[2] = north
    _, curvature_variance, _ = quadratic_cumulants(hessian, wind_covariance)
    variance += curvature_variance

    # All but driving: the model's way home at cruise, and the energy of electronics at another
    # speed.
    beyond_driving_j = max(plan.home_cost_j - modelled_j, 0.0)
    if leads_elsewhere:
        rest_j = beyond_driving_j + plan.onwards_j
        rest_j += vehicle.idle_w * onwards_m / plan.home_mps
    else:
        rest_j = beyond_driving_j * home_share + plan.onwards_j
        rest_j += vehicle.idle_w * (
            turn_m / plan.home_mps - min(turn_m, here_m) / vehicle.cruise_mps
        )
    jacobian[GAIN] += rest_j / vehicle.full_j
    energy += mean[GAIN] * rest_j / vehicle.full_j
    variance += (jacobian[EAST] ** 2 + jacobian[NORTH] ** 2) * gust_variance_to_come
    variance += (prior.model_error * energy) ** 2
    variance += (plan.unsure_j / vehicle.full_j) ** 2
    return PlanCost(energy, variance, gust_share, gust_variance_to_come)


@called
def _way_back(
    vehicle: Any,
    prior: Any,
    robot: Any,
    plan: Any,
    turn_m: float,
    hypothesis: Any,
    places: Any,
    rollings: Any,
    gust_share: float,
    jacobian: Any,
    hessian: Any,
    stretch_jacobian: Any,
) -> tuple[float, float, float]:
    """The way home back along the way out.

    Returns:
        Energy of driving it at cruise by the robot's own model, J; that by the hypothesis; its
        variance beyond the states'.
    """
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    here_m = robot.position_m
    modelled_j = 0.0
    energy = 0.0
    variance = 0.0
    place_here = place_of(vehicle, here_m, places)
    for k in range(place_here + 1):
        start_m = k * vehicle.place_m
        end_m = (k + 1) * vehicle.place_m
        if k == place_here:
            end_m = here_m
        # beyond it, it drives home already before it heads home
        border_m = min(max(turn_m, start_m), end_m)
        place = places[k]
        modelled_j += modelled_driving(vehicle, -place.sine_driven, vehicle.cruise_mps) * (
            end_m - start_m
        )
        rolled = rollings[k] / max(hypothesis.rolled, LEAST_ROLLED)
        for way_m, speed_mps in (
            (border_m - start_m, plan.home_mps),
            (end_m - border_m, plan.speed_mps),
        ):
            if way_m > 0.0:
                stretch = Stretch(
                    way_m=way_m,
                    sine=-place.sine_driven,
                    east=-place.east,
                    north=-place.north,
                    speed_mps=speed_mps,
                    rolled=rolled,
                    climb_share=way_m / here_m,
                    gust_share=gust_share,
                )
                stretch_energy, residual_variance = predict(
                    vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
                )
                energy += stretch_energy
                variance += residual_variance
    return modelled_j, energy, variance


@called
def _other_way_home(
    vehicle: Any,
    prior: Any,
    ways: Any,
    hypothesis: Any,
    gust_share: float,
    jacobian: Any,
    hessian: Any,
    stretch_jacobian: Any,
) -> tuple[float, float, float]:
    """The way home along `ways`, which are new ground; returns as `_way_back`."""
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    modelled_j = 0.0
    energy = 0.0
    variance = 0.0
    for way in ways:
        modelled_j += modelled_driving(vehicle, way.sine, vehicle.cruise_mps) * way.way_m
        stretch = Stretch(
            way_m=way.way_m,
            sine=way.sine,
            east=way.east,
            north=way.north,
            speed_mps=way.speed_mps,
            rolled=-1.0,
            climb_share=0.0,
            gust_share=gust_share,
        )
        stretch_energy, residual_variance = predict(
            vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
        )
        energy += stretch_energy
        variance += residual_variance
    return modelled_j, energy, variance


@called
def _add_onwards(
    vehicle: Any,
    prior: Any,
    robot: Any,
    plan: Any,
    turn_m: float,
    hypothesis: Any,
    places: Any,
    gust_share: float,
    jacobian: Any,
    hessian: Any,
    stretch_jacobian: Any,
    energy: float,
    variance: float,
) -> tuple[float, float]:
    """Add the new ground up to the turn, out and home, to an energy and its variance beyond the
    states'."""
    mean = hypothesis.mean
    covariance = hypothesis.covariance
    reached_m = robot.position_m
    k = place_of(vehicle, reached_m, places)
    while reached_m < turn_m:
        border_m = turn_m
        if plan.knows_ahead > 0.0 and k < len(places) - 1:
            border_m = min((k + 1) * vehicle.place_m, turn_m)
        way_m = max(border_m - reached_m, 0.0)
        place = places[k]
        sine = place.sine
        if plan.knows_ahead == 0.0 and np.isfinite(plan.sine):
            sine = plan.sine
        for ahead, speed_mps in ((1.0, plan.speed_mps), (-1.0, plan.home_mps)):
            stretch = Stretch(
                way_m=way_m,
                sine=ahead * sine,
                east=ahead * place.east,
                north=ahead * place.north,
                speed_mps=speed_mps,
                rolled=-1.0,
                climb_share=0.0,
                gust_share=gust_share,
            )
            stretch_energy, residual_variance = predict(
                vehicle, prior, mean, covariance, stretch, jacobian, hessian, stretch_jacobian
            )
            energy += stretch_energy
            variance += residual_variance
        reached_m = max(border_m, reached_m)
        k = min(k + 1, len(places) - 1)
    return energy, variance


@inline
def _duration_s(ways: Any) -> float:
    """Duration of a way, s."""
    total_s = 0.0
    for way in ways:
        total_s += way.way_m / way.speed_mps
    return total_s
