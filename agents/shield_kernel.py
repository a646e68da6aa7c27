"""The shield's arithmetic, compiled: how well each imagined day explains the drive so far, and what it leaves to spare.

A day says how the robot's true consumption differs from its own model: what the gauge is worth, the moved mass, the
rolling resistance of each place over that of the day, and the wind. The rolling resistance of the day itself is fitted,
for each imagined day apart, by weighted least squares.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from homeward.physics import model
from homeward.physics.jit import compiled, inline


class Vehicle(NamedTuple):
    """Numbers of the robot's own model, and of its way home."""

    rolling_n: float
    weight_n: float
    drag_ns2_per_m2: float
    efficiency: float
    usable_j: float
    place_m: float
    places: int
    home_mps: float  # speed of the way home
    idle_w: float
    slower_j_per_m: float  # what a metre home takes beyond the speed at which `home_cost` is costed


@inline
def _place(v: Any, position_m: float) -> Any:
    return min(max(int(position_m / v.place_m), 0), v.places - 1)


@compiled
def learn(v: Any, days: Any, drives: Any, squares: Any, energy_j: Any) -> None:
    """Add a decision of each mission to the sums that say how well each day explains it.

    On a day, a decision takes b x + r: x is the rolling by the robot's own model, b its unknown ratio, and r all else.
    Squares are weighted with the inverse of the modelled energy, so that errors of one share count alike wherever they
    fall.

    Args:
        v: `Vehicle`.
        days: True energy used over that of the gauge (days,), mass (days,), ground and headwind (places, days).
        drives: `DRIVE_DTYPE`, shape (n,).
        squares: Written: sums of x x, x r and r r, r as what is used less what the day explains, shape (n, 3, days).
        energy_j: Written: sum of the modelled energy, J, shape (n,).
    """
    gauge, mass, ground, headwind = days
    for i in range(len(drives)):
        d = drives[i]
        moved_m = abs(d.to_m - d.from_m)
        moves = moved_m > 1e-6 * v.place_m
        rolling_j = v.rolling_n * moved_m / v.efficiency
        drive_j = d.modelled_j - d.ancillary_j
        # Where the robot rolls down by itself, by its own model or on a day, nothing shows what rolling takes.
        least_j = 0.05 * rolling_j
        if d.modelled_j <= 0.0 or (moves and drive_j <= least_j):
            continue
        drag_j = model.drag_force(v, d.speed_mps) * moved_m / v.efficiency
        grade_j = drive_j - rolling_j - drag_j if moves else 0.0
        near = _place(v, 0.75 * d.from_m + 0.25 * d.to_m)
        far = _place(v, 0.25 * d.from_m + 0.75 * d.to_m)
        ahead = 1.0 if d.to_m > d.from_m else -1.0
        half_j_per_n, weight = 0.5 * moved_m / v.efficiency, 1.0 / d.modelled_j
        energy_j[i] += d.modelled_j
        headwind_near, headwind_far, ground_near, ground_far = headwind[near], headwind[far], ground[near], ground[far]
        for j in range(len(gauge)):
            used_j = gauge[j] * d.used_j
            counts = weight * (not moves or used_j - d.ancillary_j > least_j)
            wind_n = model.wind_force(v, d.speed_mps, ahead * headwind_near[j]) + model.wind_force(
                v, d.speed_mps, ahead * headwind_far[j]
            )
            x_j = 0.5 * (ground_near[j] + ground_far[j]) * rolling_j
            r_j = used_j - d.modelled_j + rolling_j - (mass[j] - 1.0) * grade_j - wind_n * half_j_per_n
            squares[i, 0, j] += counts * x_j * x_j
            squares[i, 1, j] += counts * x_j * r_j
            squares[i, 2, j] += counts * r_j * r_j


@inline
def _fit(squares: Any, energy_j: float, least: float, most: float, j: int) -> Any:
    """Rolling of a day over the robot's own, and the root mean square error that is left, as a share of the energy."""
    xx, xr, rr = squares[0, j], squares[1, j], squares[2, j]
    b = xr / xx if xx > 0.0 else most
    b = min(max(b, least), most)
    return b, np.sqrt(max(rr - b * (2.0 * xr - b * xx), 0.0) / max(energy_j, 1e-9))


@inline
def _spare_j(v: Any, days: Any, capacity: float, j: int, b: float, sines: Any, p: Any, margin: float) -> Any:
    """Energy that a day leaves beyond a decision and the way home after it, J."""
    gauge, mass, ground, headwind = days
    here = _place(v, p.position_m)
    weight_n = mass[j] * v.weight_n
    still_n = model.drag_force(v, v.home_mps)
    more_j = 0.0
    for k in range(here + 1):
        own_n = v.rolling_n - v.weight_n * sines[k] + still_n
        true_n = b * ground[k, j] * v.rolling_n - weight_n * sines[k] + still_n
        true_n += model.wind_force(v, v.home_mps, -headwind[k, j])
        length_m = min(v.place_m, p.position_m - k * v.place_m)
        more_j += (max(true_n, 0.0) - max(own_n, 0.0)) * length_m / v.efficiency
    home_j = p.home_cost_j + v.slower_j_per_m * p.position_m + more_j
    outwards = p.ends_m > p.position_m
    ahead = 1.0 if outwards else -1.0
    rolls_n = b * ground[here, j] * v.rolling_n
    # Ground ahead may be as steep as what is seen of it, on the way out as on the way home.
    metre_n = rolls_n - weight_n * p.least_sine + still_n + model.wind_force(v, v.home_mps, -headwind[here, j])
    metre_j = v.idle_w / v.home_mps + max(metre_n, 0.0) / v.efficiency
    home_j = max(home_j + metre_j * (p.ends_m - p.position_m), 0.0)
    force_n = rolls_n + ahead * weight_n * p.most_sine + model.drag_force(v, p.speed_mps)
    force_n += model.wind_force(v, p.speed_mps, ahead * headwind[here, j])
    decision_j = p.ancillary_j + max(force_n, 0.0) * p.moves_m / v.efficiency
    left_j = v.usable_j * (capacity - gauge[j] * (1.0 - p.energy))
    return left_j - decision_j - (1.0 + margin) * home_j


@compiled
def spare(
    v: Any, days: Any, capacity: Any, rolling: Any, squares: Any, energy_j: Any, sines: Any, plans: Any,
    tolerance: float, nearest: int, margin: float, spare_j: Any,
) -> None:  # fmt: skip
    """Least energy that a plan leaves beyond the way home, on any of the days that explain the drive.

    Args:
        v: `Vehicle`.
        days: As in `learn`.
        capacity: Battery capacity over the robot's own, shape (days,).
        rolling: Least and most of rolling resistance over the robot's own.
        squares: From `learn`.
        energy_j: From `learn`.
        sines: Sine of the slope of each place along the way out, shape (n, places).
        plans: `PLAN_DTYPE`, shape (n,).
        tolerance: Error of a day that explains the drive, as a share of the energy.
        nearest: Days that count whatever their error: those with the least.
        margin: Share of the way home to be kept beyond it.
        spare_j: Written where a plan is in doubt, shape (n,).
    """
    mass = days[1]
    fitted, errors = np.empty(len(mass)), np.empty(len(mass))
    for i in range(len(plans)):
        if not plans[i].in_doubt:
            continue
        close = 0
        for j in range(len(mass)):
            fitted[j], errors[j] = _fit(squares[i], energy_j[i], rolling[0] * mass[j], rolling[1] * mass[j], j)
            close += errors[j] <= tolerance
        limit = tolerance if close >= nearest else np.partition(errors, nearest - 1)[nearest - 1]
        least_j = np.inf
        for j in range(len(mass)):
            if errors[j] <= limit:
                least_j = min(least_j, _spare_j(v, days, capacity[j], j, fitted[j], sines[i], plans[i], margin))
        spare_j[i] = least_j
