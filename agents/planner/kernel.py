"""Compiled part of the planner: choice of two Lagrange multipliers of a survey by simulating it to
its turn.

The simulation uses the posterior mean of the robot and the wind. Energies are shares of the usable
energy, and powers shares per second. `energy_multiplier` is the multiplier of energy (information
per full battery), `sample_multiplier` that of memory (information per sample). The Lagrangian of a
metre is

    information found - energy_multiplier * energy - sample_multiplier * samples taken.

Arguments that functions share:

    belief: Record of `BELIEF_DTYPE`.
    vehicle: `homeward.estimation.drive.Vehicle`.
    model: Record of `MODEL_DTYPE`.
    shared: Record of `SHARED_DTYPE`.
    drive: Energy of a metre out at each speed level and, last, of a metre home, shape (LEVELS +
    1,).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs import sensing
from homeward.envs.actions import LEVELS
from homeward.envs.state import AHEAD
from homeward.estimation.drive import climbing, drag, modelled_driving, rolling
from homeward.physics.jit import called, compiled
from homeward.physics.model import headwind

EAGERNESS = np.array([0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 1.9, 2.5])
"""Multipliers of energy that are tried, over the information per energy on average ground at the
middle sensing rate. Chosen: with `STOPS` 80 simulations a decision; more are finer and take
longer."""
STOPS = np.array([-1.0, 0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0, 2.5, 3.5])
"""Distances from home up to which a stop for the radio is worth its energy, in half-rate distances
of the link: each determines a multiplier of memory; below 0 it is 0. Chosen as `EAGERNESS`."""
_KINDS = 3
"""Equally frequent kinds of ground that approximate the distribution of interest within a stretch.
Chosen: more approximate it better, and the time grows in proportion."""
_LEAST_RATIO = 0.1
"""Lower bound of the consumption of a metre over the model's. Chosen: above 0, because energy is
divided by it."""

BELIEF_DTYPE = np.dtype(
    [
        *(
            (name, np.float64)
            for name in (
                # factor on the model's energy, by the estimated battery: all but rolling and
                # climbing
                "gain",
                "rolling",  # the same of rolling
                "weight",  # and of climbing
                "wind_east_mps",  # wind with its gust, towards where it comes from
                "wind_north_mps",
                "reserve",  # energy kept beyond that of the way home, as a share of it
                # energy left beyond the slowest next decision, the way home and the reserve
                "margin",
                "left_s",  # time until the time limit
                "position_m",  # from home
                "backlog",  # samples on board
                "east",  # direction of the way out, as a unit vector
                "north",
                "sine_here",  # of the slope of the way out
                "interest_here",
            )
        ),
        # means of the stretches of `homeward.envs.state.AHEAD`
        ("sine_ahead", np.float64, (len(AHEAD),)),
        ("interest_ahead", np.float64, (len(AHEAD),)),
    ]
)
"""State of a mission and posterior mean of its hidden variables."""

MODEL_DTYPE = np.dtype(
    [
        ("speeds_mps", np.float64, (LEVELS,)),
        ("rates_hz", np.float64, (LEVELS,)),
        ("sensing", np.float64, (LEVELS,)),  # power of sensing at each rate
        ("standing", np.float64),  # power at a stand
        ("steepest", np.float64),  # sines of the table below: evenly from -steepest to steepest
        ("per_m", np.float64, (LEVELS, 71)),  # energy of a metre by speed and sine, without sensing
        ("interest", np.float64),  # mean interest of all ground
        # interest of each kind of ground, over the mean
        ("spread", np.float64, (len(AHEAD), _KINDS)),
        # information of a metre at interest 1, by speed and rate
        ("found", np.float64, (LEVELS, LEVELS)),
    ]
)
"""Constants of the robot's own model."""


@compiled
def plan(beliefs: Any, vehicle: Any, models: Any, constants: Any, commands: Any) -> None:
    """Choose the next command of surveys on their way out.

    Each survey is simulated with every pair of multipliers of `EAGERNESS` and `STOPS`. The pair
    that finds the most information determines the command, which maximises the Lagrangian.

    Args:
        beliefs: `BELIEF_DTYPE`, shape (n,).
        vehicle: `homeward.estimation.drive.Vehicle`.
        models: `MODEL_DTYPE`, shape (1,).
        constants: `SHARED_DTYPE`, shape (1,).
        commands: Written: speed (m/s), sensing rate (Hz) and 1 to stop for the radio, shape (n, 3).
    """
    shared, model = constants[0], models[0]
    drives = np.empty((1 + len(AHEAD), LEVELS + 1))
    for n in range(len(beliefs)):
        belief = beliefs[n]
        _drive(belief, vehicle, model, shared, belief.sine_here, drives[0])
        for stretch in range(len(AHEAD)):
            _drive(belief, vehicle, model, shared, belief.sine_ahead[stretch], drives[1 + stretch])
        information = model.interest * model.found[LEVELS - 1, LEVELS // 2]
        cost = (
            drives[1, LEVELS - 1]
            + drives[1, LEVELS]
            + belief.gain * model.sensing[LEVELS // 2] / model.speeds_mps[LEVELS - 1]
        )
        most_information = -1.0
        best_energy = information / cost
        best_sample = 0.0
        for eagerness in EAGERNESS:
            for stop in STOPS:
                energy_multiplier = eagerness * information / cost
                sample_multiplier = 0.0
                if stop >= 0.0:
                    sample_multiplier = (
                        energy_multiplier
                        * belief.gain
                        * model.standing
                        / _radio(shared, stop * shared.link_m, False)
                    )
                information_found = _follow(
                    belief, model, shared, drives, energy_multiplier, sample_multiplier
                )
                if information_found > most_information:
                    most_information = information_found
                    best_energy = energy_multiplier
                    best_sample = sample_multiplier
        _command(belief, model, shared, drives[0], best_energy, best_sample, commands[n])


@compiled
def efficient_speeds(
    beliefs: Any, vehicle: Any, models: Any, constants: Any, ahead: Any, speeds_mps: Any
) -> None:
    """Choose for each robot the speed that consumes least per metre where it is, if the margin
    suffices.

    Args:
        beliefs: See `plan`, as the next three.
        vehicle: The robot's own model.
        models: Shape (1,).
        constants: Shape (1,).
        ahead: 1 for robots driving out and -1 for those driving home, shape (n,).
        speeds_mps: Written, m/s, shape (n,).
    """
    shared, model = constants[0], models[0]
    for n in range(len(beliefs)):
        least_cost = np.inf
        drive = np.zeros(LEVELS + 1)
        belief = beliefs[n]
        _drive(belief, vehicle, model, shared, belief.sine_here, drive)
        for speed in range(LEVELS):
            if ahead[n] < 0.0:
                cost = _cost(belief, vehicle, model, shared, speed, belief.sine_here, -1.0)
                is_allowed = True
            else:
                cost = drive[speed]
                is_allowed = _fits(belief, model, shared, drive, speed)
            if cost < least_cost and is_allowed:
                least_cost = cost
                speeds_mps[n] = model.speeds_mps[speed]


@called
def _radio(shared: Any, position_m: float, moving: bool) -> float:
    """Samples that the radio sends per second at a distance from home."""
    share = 1.0
    if moving:
        share = sensing.DRIVING_LINK
    return float(share * shared.radio_hz / sensing.fading(position_m, shared.per_link_m))


@called
def _metre(model: Any, speed: int, sine: float) -> float:
    """Energy of a metre by the model at a speed level, interpolated linearly in the sine of the
    slope."""
    last_sine = model.per_m.shape[1] - 1
    steepness = min(max(sine / model.steepest, -1.0), 1.0)
    entry = (steepness + 1.0) * 0.5 * last_sine
    low = min(int(entry), last_sine - 1)
    low_energy = model.per_m[speed, low]
    high_energy = model.per_m[speed, low + 1]
    return float(low_energy + (entry - low) * (high_energy - low_energy))


@called
def _best_way(
    energy_gain: float,
    model: Any,
    drive: Any,
    interest: float,
    energy_multiplier: float,
    sample_multiplier: float,
) -> tuple[int, int]:
    """Levels of speed and sensing rate that maximise the Lagrangian of a metre out.

    `energy_gain` is `gain` of the belief.
    """
    best_value = -1e300
    best_speed = LEVELS - 1
    best_rate = 0
    for speed in range(LEVELS):
        s_per_m = 1.0 / model.speeds_mps[speed]
        for rate in range(LEVELS):
            value = (
                interest * model.found[speed, rate]
                - sample_multiplier * model.rates_hz[rate] * s_per_m
            )
            value -= energy_multiplier * (
                drive[speed] + energy_gain * model.sensing[rate] * s_per_m
            )
            if value > best_value:
                best_value = value
                best_speed = speed
                best_rate = rate
    return best_speed, best_rate


@called
def _follow(
    belief: Any,
    model: Any,
    shared: Any,
    drives: Any,
    energy_multiplier: float,
    sample_multiplier: float,
) -> float:
    """Simulate the way out, place by place, and return the information found.

    In each place the robot first stops until the backlog is sent, if that has a positive
    Lagrangian, and then drives as in `_way`. It turns when the margin or the time is used up, or at
    the end of the route. A full memory makes it stop, or lose information if energy or time do not
    suffice for that.

    Args:
        drives: `drive` here and in each stretch ahead, shape (1 + stretches, LEVELS + 1).
    """
    place = min(int(belief.position_m * shared.per_place_m), shared.places - 1)
    position_m = belief.position_m
    margin = belief.margin
    backlog = belief.backlog
    left_s = belief.left_s - position_m / shared.cruise_mps
    information = 0.0
    stretch = -1
    way = _way(
        model,
        belief.gain,
        drives[0],
        belief.interest_here,
        model.spread[0],
        energy_multiplier,
        sample_multiplier,
    )
    for k in range(place, shared.places):
        if stretch + 1 < len(AHEAD) and k - place == AHEAD[stretch + 1][0]:
            stretch += 1
            way = _way(
                model, belief.gain, drives[1 + stretch], belief.interest_ahead[stretch], model.spread[stretch],
                energy_multiplier, sample_multiplier,
            )  # fmt: skip
        gain, energy, samples, time_s = way
        radio_hz = _radio(shared, position_m, False)
        if sample_multiplier * radio_hz > energy_multiplier * belief.gain * model.standing:
            stop_s = min(backlog / radio_hz, max(left_s, 0.0))
            margin -= stop_s * belief.gain * model.standing
            left_s -= stop_s
            backlog -= stop_s * radio_hz
        if margin <= 0.0 or left_s <= 0.0:
            break
        room_m = (k + 1) * shared.place_m - position_m
        way_m = min(room_m, margin / energy, left_s / (time_s + 1.0 / shared.cruise_mps))
        position_m += way_m
        margin -= way_m * energy
        left_s -= way_m * (time_s + 1.0 / shared.cruise_mps)
        sent = way_m * time_s * _radio(shared, position_m, True)
        samples_taken = way_m * samples
        backlog = max(backlog + samples_taken - sent, 0.0)
        information += way_m * gain
        if backlog > shared.backlog_limit:
            # It stops until there is room, or loses what does not fit if energy or time do not
            # suffice.
            excess = backlog - shared.backlog_limit
            stop_s = excess / _radio(shared, position_m, False)
            backlog = shared.backlog_limit
            if stop_s * belief.gain * model.standing <= margin and stop_s <= left_s:
                margin -= stop_s * belief.gain * model.standing
                left_s -= stop_s
            else:
                information -= way_m * gain * min(excess / max(samples_taken, 1e-9), 1.0)
        if way_m < room_m:
            break
    return information


@called
def _way(
    model: Any,
    energy_gain: float,
    drive: Any,
    interest: float,
    spread: Any,
    energy_multiplier: float,
    sample_multiplier: float,
) -> tuple[float, float, float, float]:
    """Information, energy out and home, samples and time (s) of a metre, on average over the ground
    of a stretch.

    Args:
        interest: Mean interest of the stretch.
        spread: Interest of each kind of ground over the mean, shape (_KINDS,).
    """
    gain = energy = samples = time_s = 0.0
    for kind in spread:
        weight = interest * kind
        speed, rate = _best_way(
            energy_gain, model, drive, weight, energy_multiplier, sample_multiplier
        )
        s_per_m = 1.0 / model.speeds_mps[speed]
        gain += weight * model.found[speed, rate]
        energy += drive[speed] + energy_gain * model.sensing[rate] * s_per_m
        samples += model.rates_hz[rate] * s_per_m
        time_s += s_per_m
    return (
        gain / _KINDS,
        energy / _KINDS + drive[LEVELS],
        samples / _KINDS,
        time_s / _KINDS,
    )


@called
def _drive(belief: Any, vehicle: Any, model: Any, shared: Any, sine: float, drive: Any) -> None:
    """Write `drive` on a slope: a metre out at each speed and, last, home at the fastest, with the
    reserve."""
    for speed in range(LEVELS):
        drive[speed] = _cost(belief, vehicle, model, shared, speed, sine, 1.0)
    drive[LEVELS] = (1.0 + belief.reserve) * _cost(
        belief, vehicle, model, shared, LEVELS - 1, sine, -1.0
    )


@called
def _cost(
    belief: Any, vehicle: Any, model: Any, shared: Any, speed: int, sine: float, ahead: float
) -> float:
    """Energy of a metre out (`ahead` 1) or home (-1) on a slope of the way out, by the posterior
    mean.

    The model's energy times `gain`, with its driving replaced by that with the estimated rolling,
    weight and wind.
    """
    speed_mps = model.speeds_mps[speed]
    against_mps = ahead * headwind(
        belief.wind_east_mps, belief.wind_north_mps, belief.east, belief.north
    )
    more_j = belief.rolling * rolling(vehicle, sine) + belief.weight * climbing(
        vehicle, ahead * sine
    )
    more_j = max(more_j + belief.gain * drag(vehicle, speed_mps, against_mps), 0.0)
    more_j -= belief.gain * modelled_driving(vehicle, ahead * sine, speed_mps)
    modelled = _metre(model, speed, ahead * sine)
    return float(max(belief.gain * modelled + more_j / shared.usable_j, _LEAST_RATIO * modelled))


@called
def _fits(belief: Any, model: Any, shared: Any, drive: Any, speed: int) -> bool:
    """Whether the margin suffices for a decision at a speed, out and home; at the lowest it always
    does."""
    more_m = (model.speeds_mps[speed] - model.speeds_mps[0]) * shared.decision_s
    return bool(more_m * (drive[speed] + drive[LEVELS]) <= max(belief.margin, 0.0))


@called
def _command(
    belief: Any,
    model: Any,
    shared: Any,
    drive: Any,
    energy_multiplier: float,
    sample_multiplier: float,
    command: Any,
) -> None:
    """Write the command of the next decision, which maximises the Lagrangian: see `plan`."""
    radio_hz = _radio(shared, belief.position_m, False)
    standing = energy_multiplier * belief.gain * model.standing
    stops = (
        sample_multiplier * radio_hz > standing and belief.backlog >= radio_hz * shared.decision_s
    )
    # Part of the next decision may be in the next place.
    step_m = shared.max_speed_mps * shared.decision_s
    beyond = (
        belief.position_m
        + step_m
        - (np.floor(belief.position_m * shared.per_place_m) + 1.0) * shared.place_m
    )
    share = min(max(beyond / step_m, 0.0), 1.0)
    interest = (1.0 - share) * belief.interest_here + share * belief.interest_ahead[0]
    speed, rate = _best_way(
        belief.gain, model, drive, interest, energy_multiplier, sample_multiplier
    )
    if belief.backlog + model.rates_hz[rate] * shared.decision_s > shared.backlog_limit:
        # The memory is full: samples taken now must be sent from here.
        speed, rate = _best_way(
            belief.gain,
            model,
            drive,
            interest,
            energy_multiplier,
            max(sample_multiplier, standing / radio_hz),
        )
        stops = (
            stops
            or belief.backlog + model.rates_hz[rate] * shared.decision_s > shared.backlog_limit
        )
    while not _fits(belief, model, shared, drive, speed):
        speed -= 1
    command[0] = model.speeds_mps[speed]
    command[1] = model.rates_hz[rate]
    command[2] = 1.0 if stops else 0.0
    if stops:
        command[1] = 0.0
