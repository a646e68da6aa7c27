"""The arithmetic of `homeward.agents.identification`, compiled: what a robot takes on a day, and which day it may be.

Five numbers are not known (`UNKNOWN`). With them a decision takes, by the gauge,

    g A + sum over its stretches of (r R + s W + g c u |u|)+ d / Gamma,    u = v + w . h,

where A is all but driving by the robot's own model, R rolling friction and W weight along the slope by the file, c the
drag, h the direction of travel, w the wind and d the length of a stretch. The numbers looked for are the likeliest ones
(maximum of the posterior). They are found by Gauss-Newton steps; as the wind makes the problem one with several maxima,
they begin at several winds, and what explains the drive about as well is kept beside the best.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from homeward.physics import model
from homeward.physics.jit import compiled, inline

UNKNOWN = ("gauge", "rolling", "weight", "wind_east_mps", "wind_north_mps")
"""What the gauge shows over what the file says, g of all energy, r of rolling, s of climbing; and the wind w, towards
where it comes from. The energy is linear in all but the wind."""
_G, _R, _S, _EAST, _NORTH = range(5)
_LEAST = np.array([0.5, 0.2, 0.4, -15.0, -15.0])
_MOST = np.array([3.0, 6.0, 6.0, 15.0, 15.0])
"""Bounds of a fit, beyond all that `homeward.envs.difficulty` and `homeward.envs.routes` draw: steps stop there."""
STARTS_MPS = np.array(
    [
        [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0), (-2.0, 0.0), (0.0, -2.0)],
        [(0.0, 0.0), (2.1, 2.1), (-2.1, 2.1), (-2.1, -2.1), (2.1, -2.1)],
        [(0.0, 0.0), (5.0, 0.0), (0.0, 5.0), (-5.0, 0.0), (0.0, -5.0)],
        [(0.0, 0.0), (3.5, 3.5), (-3.5, 3.5), (-3.5, -3.5), (3.5, -3.5)],
    ]
)
"""Winds to begin from, in turn: none, and from four sides about the routes' mean (1.9 m/s: Rayleigh of scale 1.5 m/s),
more, or, where a drive is not explained, a strong one."""
_USUAL = 2  # how many of these rounds there are where it is
# The next were chosen by trial on OutAndBack, uncertain, with two robots.
_BEGIN_AGAIN, _BEGIN_SOON = 8, 2  # decisions after which they are tried: where the drive is explained and where not
_UNEXPLAINED = 2.0  # error of a guess, over the least, above which it is not
_UNLIKELY = 10.0  # half of the squared distance from what is usual above which it is not: one in 800, were all normal
_STEPS, _HALVINGS = 4, 4  # Gauss-Newton steps of a fit, and how often one that makes it worse is halved
_CONVERGED = 0.01  # gain in the logarithm of the likelihood below which a fit ends
_SUITS = 3  # of all numbers to a wind, before that moves
_FITS = 3  # of a guess from elsewhere, each with the error that the one before has left
_FIRST_ERROR = 0.01  # from which those begin, so that they find their way
_ELSE_ERROR = 0.1  # by which all but driving may be off before there must have been driving
_HOPELESS = 1e-6  # likelihood over that of the best guess below which one is given up

DRIVE_DTYPE = np.dtype([(name, np.float64) for name in ("used_j", "modelled_j", "from_m", "to_m", "speed_mps")])
"""What driving on at one speed took: by the gauge and by the robot's own model, from where to where."""
GUESS_DTYPE = np.dtype(
    [
        ("unknown", np.float64, (len(UNKNOWN),)),
        ("factor", np.float64, (len(UNKNOWN), len(UNKNOWN))),  # Cholesky's, of the inverse of their covariance
        ("error", np.float64),  # of a decision, as a share of its energy
        ("rows", np.float64),  # drives that it was fitted to
        ("left_j", np.float64),  # that the way out took beyond what the numbers explain
        ("likelihood", np.float64),  # its logarithm
        ("weight", np.float64),  # among the guesses; 0 for none
    ]
)
"""A guess at the unknown numbers."""


class Vehicle(NamedTuple):
    """Numbers of the robot's own model, as `homeward.physics.model` asks for them."""

    rolling_resistance: float
    mass_kg: float  # with its payload
    drag_ns2_per_m2: float
    per_efficiency: float
    cruise_mps: float
    idle_w: float
    place_m: float


class Ground(NamedTuple):
    """A place along the way out, as the robot saw it: slope and direction."""

    sine: float
    east: float
    north: float


GROUND_DTYPE = np.dtype([(name, np.float64) for name in Ground._fields])
"""The same as a record."""


class Prior(NamedTuple):
    """What is usual, before anything was driven."""

    mean: Any  # (5,)
    inverse: Any  # of the covariance, (5, 5)
    least_error: float  # of a decision, as a share of its energy, that is always reckoned with


@inline
def _rolling_and_climbing(v: Any, sine: float) -> tuple[float, float]:
    """Rolling friction and weight along a slope by the file, N."""
    return model.rolling_force(v, np.sqrt(max(1.0 - sine * sine, 0.0))), model.grade_force(v, sine)


@inline
def driving(v: Any, unknown: Any, ground: Any, ahead: float, speed_mps: float, least_n: float, slopes: Any) -> float:
    """Energy that driving a metre takes by the gauge, J/m, and in `slopes` by how much each unknown number raises it.

    Args:
        v: `Vehicle`.
        unknown: Shape (5,).
        ground: Where.
        ahead: 1 away from home, -1 towards it.
        speed_mps: How fast.
        least_n: Force below which there is none: 0, or -inf to know what would have to be overcome.
        slopes: Written, shape (5,).
    """
    rolling_n, climbing_n = _rolling_and_climbing(v, ahead * ground.sine)
    east, north = ahead * ground.east, ahead * ground.north
    headwind_mps = unknown[_EAST] * east + unknown[_NORTH] * north
    drag_n = model.drag_force(v, speed_mps) + model.wind_force(v, speed_mps, headwind_mps)
    force_n = unknown[_R] * rolling_n + unknown[_S] * climbing_n + unknown[_G] * drag_n
    if force_n <= least_n:
        slopes[:] = 0.0
        return 0.0
    gust = 2.0 * unknown[_G] * v.drag_ns2_per_m2 * abs(speed_mps + headwind_mps) * v.per_efficiency
    slopes[_G] = drag_n * v.per_efficiency
    slopes[_R], slopes[_S] = rolling_n * v.per_efficiency, climbing_n * v.per_efficiency
    slopes[_EAST], slopes[_NORTH] = gust * east, gust * north
    return float(force_n * v.per_efficiency)


@inline
def modelled_driving(v: Any, ground: Any, ahead: float, speed_mps: float) -> float:
    """The same by the robot's own model, which costs a place at cruise and adds the drag of another speed."""
    rolling_n, climbing_n = _rolling_and_climbing(v, ahead * ground.sine)
    at_cruise_n = model.drag_force(v, v.cruise_mps)
    force_n = max(rolling_n + climbing_n + at_cruise_n, 0.0)
    return float(max(force_n + model.drag_force(v, speed_mps) - at_cruise_n, 0.0) * v.per_efficiency)


@inline
def _decision(
    v: Any, unknown: Any, d: Any, grounds: Any, least_n: float, slopes: Any, metre: Any
) -> tuple[float, float]:
    """Energy of driving and of all else in a decision by the gauge, J, and by how much each number raises both."""
    slopes[:] = 0.0
    drive_j = own_j = 0.0
    ahead = 1.0 if d.to_m > d.from_m else -1.0
    reached_m, end_m = min(d.from_m, d.to_m), max(d.from_m, d.to_m)
    last = len(grounds) - 1
    k = min(int(reached_m / v.place_m), last)
    while reached_m < end_m:
        border_m = min((k + 1) * v.place_m, end_m) if k < last else end_m
        way_m = max(border_m - reached_m, 0.0)
        drive_j += way_m * driving(v, unknown, grounds[k], ahead, d.speed_mps, least_n, metre)
        own_j += way_m * modelled_driving(v, grounds[k], ahead, d.speed_mps)
        for a in range(len(slopes)):
            slopes[a] += way_m * metre[a]
        reached_m, k = max(border_m, reached_m), min(k + 1, last)
    slopes[_G] += d.modelled_j - own_j
    return drive_j, float(unknown[_G] * (d.modelled_j - own_j))


@inline
def _left_j(v: Any, unknown: Any, d: Any, grounds: Any, error: float, slopes: Any, metre: Any) -> float:
    """Energy of a decision that a guess does not explain, J."""
    drive_j, else_j = _decision(v, unknown, d, grounds, 0.0, slopes, metre)
    left_j = d.used_j - drive_j - else_j
    if (
        left_j > error * d.modelled_j + _ELSE_ERROR * else_j
    ):  # it had to be driven where the guess lets it roll by itself
        drive_j, else_j = _decision(v, unknown, d, grounds, -np.inf, slopes, metre)
        left_j = d.used_j - drive_j - else_j
    return float(left_j)


@inline
def _factor(matrix: Any) -> None:
    """Cholesky's factor of a symmetric positive matrix, in the place of its lower part."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(max(total, 1e-300)) if i == j else total / matrix[j, j]


@inline
def _solve(factor: Any, target: Any) -> None:
    """Solve in place with the matrix of a Cholesky factor."""
    for i in range(len(target)):
        for k in range(i):
            target[i] -= factor[i, k] * target[k]
        target[i] /= factor[i, i]
    for i in range(len(target) - 1, -1, -1):
        for k in range(i + 1, len(target)):
            target[i] -= factor[k, i] * target[k]
        target[i] /= factor[i, i]


@inline
def _unusual(prior: Any, unknown: Any) -> float:
    """Half of the squared distance from what is usual, in standard deviations."""
    half = 0.0
    for a in range(len(unknown)):
        for b in range(len(unknown)):
            half += 0.5 * prior.inverse[a, b] * (unknown[a] - prior.mean[a]) * (unknown[b] - prior.mean[b])
    return half


@compiled
def _misfit(
    v: Any, prior: Any, unknown: Any, drives: Any, grounds: Any, error: float, target: Any, normal: Any, work: Any
) -> tuple[float, float, float]:
    """How unusual a guess is, the mean square of its errors, and what it leaves of the way out, J.

    `target` and `normal` become the equations of a Gauss-Newton step.
    """
    slopes, metre = work
    unusual = squares = outwards_j = 0.0
    for a in range(len(unknown)):
        target[a] = 0.0
        for b in range(len(unknown)):
            target[a] -= prior.inverse[a, b] * (unknown[b] - prior.mean[b])
            normal[a, b] = prior.inverse[a, b]
        unusual -= 0.5 * target[a] * (unknown[a] - prior.mean[a])
    for row in range(len(drives)):
        d = drives[row]
        left_j = _left_j(v, unknown, d, grounds, error, slopes, metre)
        per_j = 1.0 / d.modelled_j
        squares += left_j * left_j * per_j * per_j
        outwards_j += left_j if d.to_m > d.from_m else 0.0
        weight = per_j * per_j / (error * error)
        for a in range(len(unknown)):
            slope = weight * slopes[a]
            target[a] += slope * left_j
            for b in range(a + 1):
                normal[a, b] += slope * slopes[b]
    return unusual, squares / max(len(drives), 1), outwards_j


@compiled
def _suit_wind(v: Any, prior: Any, unknown: Any, drives: Any, grounds: Any, error: float, work: Any) -> None:
    """Make all numbers but the wind the likeliest ones for it: a linear problem, as long as the robot has to drive."""
    (target, normal), more = work
    _misfit(v, prior, unknown, drives, grounds, error, target, normal, more)
    _factor(normal[:_EAST, :_EAST])
    _solve(normal[:_EAST, :_EAST], target[:_EAST])
    for a in range(_EAST):
        unknown[a] = min(max(unknown[a] + target[a], _LEAST[a]), _MOST[a])


@compiled
def _fit(v: Any, prior: Any, drives: Any, grounds: Any, guess: Any, work: Any) -> None:
    """Move a guess to where it is likeliest, by Gauss-Newton steps of the wind after which the rest follows."""
    target, trial, trial_work = work
    (trial_target, trial_normal), more = trial_work
    unknown, error, factor = guess.unknown, guess.error, guess.factor
    halves = 0.5 * len(drives) / (error * error)
    _suit_wind(v, prior, unknown, drives, grounds, error, trial_work)
    unusual, square, left_j = _misfit(v, prior, unknown, drives, grounds, error, target, factor, more)
    _factor(factor)
    for _ in range(_STEPS):
        _solve(factor, target)
        gained = 0.0
        for halving in range(_HALVINGS):
            for a in range(len(unknown)):
                trial[a] = min(max(unknown[a] + target[a] / (1 << halving), _LEAST[a]), _MOST[a])
            _suit_wind(v, prior, trial, drives, grounds, error, trial_work)
            trial_unusual, trial_square, trial_left_j = _misfit(
                v, prior, trial, drives, grounds, error, trial_target, trial_normal, more
            )
            gained = unusual - trial_unusual + halves * (square - trial_square)
            if gained > 0.0:
                break
        if gained <= 0.0:
            break
        for a in range(len(unknown)):  # number by number: to copy arrays whole takes seconds to compile
            unknown[a], target[a] = trial[a], trial_target[a]
            for b in range(len(unknown)):
                factor[a, b] = trial_normal[a, b]
        unusual, square, left_j = trial_unusual, trial_square, trial_left_j
        _factor(factor)
        if gained < _CONVERGED:
            break
    guess.left_j, guess.rows = left_j, len(drives)
    guess.error = np.sqrt(prior.least_error * prior.least_error + square)
    guess.likelihood = _likelihood(unusual, square, guess.error, len(drives))


@inline
def _likelihood(unusual: float, square: float, error: float, rows: int) -> float:
    """Logarithm of a guess's likelihood."""
    return float(-unusual - rows * (np.log(error) + 0.5 * square / (error * error)))


@inline
def _begin(v: Any, prior: Any, drives: Any, grounds: Any, guess: Any, wind: Any, work: Any) -> None:
    """Make a wind a guess, with all other numbers the likeliest ones for it."""
    (target, normal), more = work
    for a in range(len(prior.mean)):
        guess.unknown[a] = prior.mean[a]
    guess.unknown[_EAST], guess.unknown[_NORTH] = wind[0], wind[1]
    for _ in range(_SUITS):
        _suit_wind(v, prior, guess.unknown, drives, grounds, _FIRST_ERROR, work)
    _, square, _ = _misfit(v, prior, guess.unknown, drives, grounds, _FIRST_ERROR, target, normal, more)
    guess.error = np.sqrt(prior.least_error * prior.least_error + square)


@inline
def _is(one: Any, other: Any) -> bool:
    """Whether two guesses are the same."""
    apart_mps = abs(one.unknown[_EAST] - other.unknown[_EAST]) + abs(one.unknown[_NORTH] - other.unknown[_NORTH])
    return bool(apart_mps < 0.02 and abs(one.unknown[_R] - other.unknown[_R]) < 0.01)


@inline
def _find(guesses: Any, trial: Any) -> int:
    """Which of the guesses a trial is, or their number."""
    place = len(guesses)
    for k in range(len(guesses)):
        if guesses[k].weight > 0.0 and _is(guesses[k], trial):
            place = min(place, k)
    return place


@inline
def _keep(guesses: Any, trial: Any) -> None:
    """Put a trial in the place of the guess that it is, or else of the worst, if it is likelier."""
    place = _find(guesses, trial)
    if place == len(guesses):
        place = 0
        for k in range(len(guesses)):
            if guesses[place].weight > 0.0 and (
                guesses[k].weight == 0.0 or guesses[k].likelihood < guesses[place].likelihood
            ):
                place = k
    if guesses[place].weight == 0.0 or trial.likelihood > guesses[place].likelihood:
        trial.weight = 1.0
        guesses[place] = trial


@inline
def _weigh(guesses: Any) -> None:
    """Weigh guesses by their likelihood, the likeliest first, and give up those that are hopeless or twice there."""
    first, total = 0, 0.0
    for k in range(len(guesses)):
        if guesses[k].weight > 0.0 and guesses[k].likelihood > guesses[first].likelihood:
            first = k
    if first > 0:
        moved = guesses[:1].copy()
        guesses[0] = guesses[first]
        guesses[first] = moved[0]
    for k in range(len(guesses)):
        if guesses[k].weight > 0.0:
            weight = np.exp(guesses[k].likelihood - guesses[0].likelihood)
            guesses[k].weight = weight if weight > _HOPELESS and (k == 0 or not _is(guesses[k], guesses[0])) else 0.0
            total += guesses[k].weight
    for k in range(len(guesses)):
        guesses[k].weight /= total


@compiled
def identify(
    v: Any, prior: Any, asked: Any, decisions: Any, counts: Any, drives: Any, grounds: Any, guesses: Any
) -> None:
    """Improve the guesses of missions with what they have driven.

    Args:
        v: `Vehicle`.
        prior: `Prior`.
        asked: Which missions have something new, shape (n,).
        decisions: Decisions of each mission, shape (n,).
        counts: Drives of each mission, shape (n,).
        drives: `DRIVE_DTYPE`, shape (n, drives).
        grounds: `GROUND_DTYPE`, shape (n, places).
        guesses: `GUESS_DTYPE`, shape (n, guesses + 1): the likeliest first, the last for trials.
    """
    slopes, metre = np.empty(5), np.empty(5)
    work = np.empty(5), np.empty(5), ((np.empty(5), np.empty((5, 5))), (slopes, metre))
    for i in range(len(counts)):
        if not asked[i]:
            continue
        own, trial, driven = guesses[i, :-1], guesses[i, -1], drives[i, : counts[i]]
        explained = own[0].error <= _UNEXPLAINED * prior.least_error and _unusual(prior, own[0].unknown) <= _UNLIKELY
        every, rounds = (_BEGIN_AGAIN, _USUAL) if explained else (_BEGIN_SOON, len(STARTS_MPS))
        # On the way home nothing hangs on it any more.
        begin_again = decisions[i] % every == 0 and driven[-1].to_m > driven[-1].from_m
        if not begin_again:
            left_j = _left_j(v, own[0].unknown, driven[-1], grounds[i], own[0].error, slopes, metre)
            if abs(left_j) <= 0.5 * own[0].error * driven[-1].modelled_j:
                continue  # nothing new
        for k in range(len(own)):
            if own[k].weight > 0.0:
                _fit(v, prior, driven, grounds[i], own[k], work)
        if begin_again:
            for wind in STARTS_MPS[decisions[i] // every % rounds]:
                _begin(v, prior, driven, grounds[i], trial, wind, work[-1])
                for fit in range(_FITS):
                    if fit < _FITS - 1:  # with more, all would go where it is usual to be
                        trial.error = min(trial.error, _FIRST_ERROR)
                    _fit(v, prior, driven, grounds[i], trial, work)
                    if _find(own, trial) < len(own):
                        break
                _keep(own, trial)
        _weigh(own)


@inline
def way_home(v: Any, position_m: float, home_cost_j: float, grounds: Any, guess: Any, work: Any) -> tuple[float, float]:
    """The way home by one guess, J, and its variance."""
    slopes, metre = work
    slopes[:] = 0.0
    drive_j = own_j = 0.0
    last = len(grounds) - 1
    for k in range(min(int(position_m / v.place_m), last) + 1):
        way_m = position_m - k * v.place_m
        if k < last:
            way_m = min(way_m, v.place_m)
        drive_j += way_m * driving(v, guess.unknown, grounds[k], -1.0, v.cruise_mps, 0.0, metre)
        own_j += way_m * modelled_driving(v, grounds[k], -1.0, v.cruise_mps)
        for a in range(len(slopes)):
            slopes[a] += way_m * metre[a]
    slopes[_G] += home_cost_j - own_j
    # What the way out took for another reason, as rough ground, the way home takes too.
    cost_j = guess.unknown[_G] * (home_cost_j - own_j) + drive_j + guess.left_j
    # Noise of single decisions averages out; what the way out took for no known reason may come again.
    variance = guess.left_j * guess.left_j + (guess.error * cost_j) ** 2 / max(guess.rows, 1.0)
    # Forward substitution with the factor of the inverse covariance: the square of what comes out is the variance.
    for a in range(len(slopes)):
        for b in range(a):
            slopes[a] -= guess.factor[a, b] * slopes[b]
        slopes[a] /= guess.factor[a, a]
        variance += slopes[a] * slopes[a]
    return cost_j, variance


@inline
def _there_and_back(v: Any, unknown: Any, ground: Any, slopes: Any) -> Any:
    """Energy of driving a metre out and home at cruise, J/m."""
    out_j = driving(v, unknown, ground, 1.0, v.cruise_mps, 0.0, slopes)
    return out_j + driving(v, unknown, ground, -1.0, v.cruise_mps, 0.0, slopes)


@compiled
def look_home(
    v: Any, position_m: Any, home_cost_j: Any, onwards_m: float, sine_near: Any, grounds: Any, guesses: Any, out: Any
) -> None:
    """What the way home takes by the gauge, and what going on does.

    Args:
        v: `Vehicle`.
        position_m: Shape (n,).
        home_cost_j: By the robot's own model, shape (n,).
        onwards_m: Metres of going on, over ground as here or as near, whichever takes more.
        sine_near: Slope of the ground ahead, shape (n,).
        grounds: `GROUND_DTYPE`, shape (n, places).
        guesses: From `identify`.
        out: Written: the way home, its standard deviation, going on and from there home, and the same by the robot's
            own model, J, shape (n, 4).
    """
    slopes, metre = np.empty(5), np.empty(5)
    for i in range(len(position_m)):
        here = grounds[i, min(int(position_m[i] / v.place_m), len(grounds[i]) - 1)]
        near = Ground(sine_near[i], here.east, here.north)
        idle_j_per_m = 2.0 * v.idle_w / v.cruise_mps
        mean = square = onwards = 0.0
        for k in range(guesses.shape[1] - 1):
            guess = guesses[i, k]
            if guess.weight > 0.0:
                home_j, variance = way_home(v, position_m[i], home_cost_j[i], grounds[i], guess, (slopes, metre))
                mean += guess.weight * home_j
                square += guess.weight * (variance + home_j * home_j)
                there_and_back = max(
                    _there_and_back(v, guess.unknown, here, metre), _there_and_back(v, guess.unknown, near, metre)
                )
                onwards += guess.weight * (there_and_back + guess.unknown[_G] * idle_j_per_m)
        own = modelled_driving(v, here, 1.0, v.cruise_mps) + modelled_driving(v, here, -1.0, v.cruise_mps)
        out[i, 0], out[i, 1] = mean, np.sqrt(max(square - mean * mean, 0.0))
        out[i, 2], out[i, 3] = onwards * onwards_m, (own + idle_j_per_m) * onwards_m
