"""The battery-dissemination model: the paper's equations as plain functions, numbered as the paper
numbers them.

Each takes a `Robot` (or its record, inside compiled kernels) and floats or arrays that broadcast.

Source: Tiwari, Xiao, Chong, Estimating Achievable Range of Ground Robots Operating on Single
Battery Discharge for Operational Efficacy Amelioration, IROS 2018, arXiv 1811.03159.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numba.extending import overload

from homeward.physics.intervals import NOT_NEGATIVE, Bounds, checked
from homeward.physics.jit import inline

GRAVITY_MPS2 = 9.80665
"""Standard acceleration of gravity (ISO 80000-3)."""

ZERO_CELSIUS_K = 273.15
"""0 C in kelvin (SI Brochure, 2.3.1)."""

GRADES = Bounds(-math.pi / 2, math.pi / 2)
"""Slope angles, rad."""


@inline
def traction_efficiency(robot: Any) -> Any:
    """Gamma: share of the drive's input energy that becomes traction work.

    The paper's text gives the friction loss eta3 as 91.8 %, its Table I as an efficiency of 9.2 %.
    The presets use the table, which reproduces the paper's Omega.

    Source: the paper, below Eq. 7: Gamma = (1 - eta2)(1 - eta3).
    """
    return (1.0 - robot.motor_loss) * (1.0 - robot.friction_loss)


@inline
def rolling_force(robot: Any, cos_grade: Any = 1.0) -> Any:
    """Rolling friction C_rr m g cos(theta), N (Eq. 1; Eq. 3 on a grade)."""
    return robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2 * cos_grade


@inline
def drag_force(robot: Any, speed_mps: Any) -> Any:
    """Air drag c v^2, N (Eq. 3)."""
    return robot.drag_ns2_per_m2 * speed_mps * speed_mps


@inline
def headwind(from_east_mps: Any, from_north_mps: Any, east: Any, north: Any) -> Any:
    """Component of a wind against a direction of travel (a unit vector), m/s; negative from
    behind."""
    return from_east_mps * east + from_north_mps * north


@inline
def wind_force(robot: Any, speed_mps: Any, headwind_mps: Any) -> Any:
    """Additional air drag due to wind, c (u |u| - v^2) with u = v + w, N."""
    air_mps = speed_mps + headwind_mps
    return robot.drag_ns2_per_m2 * (air_mps * np.abs(air_mps) - speed_mps * speed_mps)


@inline
def grade_force(robot: Any, sin_grade: Any) -> Any:
    """Weight along the slope m g sin(theta), N, negative downhill (Eq. 3)."""
    return robot.mass_kg * GRAVITY_MPS2 * sin_grade


def traction_force(robot: Any, speed_mps: Any, grade_rad: Any) -> Any:
    """Force at the wheels at constant speed, N (Eq. 3). Times a distance it is the manoeuvring
    energy of Eq. 4.

    It is negative on descents steeper than tan(theta) = -C_rr, where the robot brakes: see
    `drive_power`.

    Args:
        robot: The robot.
        speed_mps: Speed, m/s, any shape.
        grade_rad: Slope angle, rad, positive uphill, any shape.

    Raises:
        ValueError: A value is outside its bounds.

    >>> import homeward
    >>> rusti = homeward.load_robot("rusti")
    >>> round(float(traction_force(rusti, 1.0, 0.0)), 3)
    0.777
    >>> bool(abs(traction_force(rusti, 0.1, np.radians(-5.71))) < 0.001)  # almost no force down the paper's incline
    True
    """
    speed_mps = checked("speed_mps", speed_mps, NOT_NEGATIVE)
    grade_rad = checked("grade_rad", grade_rad, GRADES)
    return (
        rolling_force(robot, np.cos(grade_rad))
        + drag_force(robot, speed_mps)
        + grade_force(robot, np.sin(grade_rad))
    )


@inline
def watts_per_newton(robot: Any, speed_mps: Any) -> Any:
    """Electrical power of the drive per force at the wheels, v / Gamma, W/N (second part of Eq.
    7)."""
    return speed_mps / traction_efficiency(robot)


@inline
def drive_power(robot: Any, force_n: Any, speed_mps: Any) -> Any:
    """Electrical power of the drive, W: F v / Gamma, and 0 where the force is negative.

    Dividing a negative force by Gamma would return more energy than gravity supplied. Only the
    effect `regeneration` returns energy, at most |F| v.

    On level ground at 1 m/s, without drag, where the paper's Table III has 4.82 to 6.85 W (its
    speed fell with the load):

    >>> import homeward
    >>> rusti = homeward.load_robot("rusti")
    >>> round(float(drive_power(rusti, rolling_force(rusti), 1.0)), 2)
    8.83
    """
    return np.maximum(force_n, 0.0) * watts_per_newton(robot, speed_mps)


@inline
def sensing_power(robot: Any, sensing_hz: Any) -> Any:
    """Power of the sensors s0 + s1 f_s, W (first part of Eq. 5)."""
    return robot.sensing_idle_w + robot.sensing_j_per_sample * sensing_hz


@inline
def computer_power(robot: Any, sensing_hz: Any) -> Any:
    """Power of the embedded computer, W: off when nothing is sensed, rising with the sensing rate
    (part of P_C)."""
    return (sensing_hz > 0.0) * (robot.computer_w + robot.computer_j_per_sample * sensing_hz)


def ancillary_power(robot: Any, sensing_hz: Any) -> Any:
    """Ancillary power P_anc = s0 + s1 f_s + P_C, W (Eq. 5), drawn whether the robot moves or not.

    Args:
        robot: The robot.
        sensing_hz: Sensing rate, Hz, any shape.

    Raises:
        ValueError: A value is outside its bounds.

    The formula gives 0.0350 W for the paper's sensor at 100 Hz, where 0.0348 W was measured:

    >>> import homeward
    >>> rusti = homeward.load_robot("rusti")
    >>> round(float(sensing_power(rusti, 100.0)), 4), round(float(ancillary_power(rusti, 0.0)), 4)
    (0.035, 0.5881)
    >>> ancillary_power(homeward.load_robot("rusti_computer"), np.array([0.0, 1e-9, 100.0])).round(2).tolist()
    [0.59, 8.59, 15.59]
    """
    return _ancillary_power(robot, checked("sensing_hz", sensing_hz, NOT_NEGATIVE))


def _ancillary_power(robot: Any, sensing_hz: Any) -> Any:
    return (
        sensing_power(robot, sensing_hz)
        + robot.communication_w
        + robot.controller_w
        + computer_power(robot, sensing_hz)
    )


# Compiled kernels take the formula without the check.
overload(ancillary_power, strict=False)(lambda *_: _ancillary_power)


def usable_energy(robot: Any, cycles: Any, age: Any) -> Any:
    """Battery energy left after charge cycles and age, E_O exp(-(k1 C + k2 t)), J (Eq. 6).

    The paper gives k1 and k2 no unit. Taken per cycle, ten cycles would consume 71 % of the
    battery, so C and t are normalised, and a robot file states what one unit is. As in the paper,
    the battery loss eta1 is part of this equation and of Omega, not a factor of its own.

    Args:
        robot: The robot.
        cycles: C, in the unit that the robot's `cycle_fade` is per, any shape.
        age: t, in the unit that the robot's `age_fade` is per, any shape.

    Raises:
        ValueError: A value is outside its bounds.

    >>> import homeward
    >>> rusti = homeward.load_robot("rusti")
    >>> float(usable_energy(rusti, 0.0, 0.0))
    55440.0
    >>> round(float(1 - usable_energy(rusti, 10.0, 0.0) / 55440.0), 2)
    0.71
    """
    cycles = checked("cycles", cycles, NOT_NEGATIVE)
    age = checked("age", age, NOT_NEGATIVE)
    fade = robot.cycle_fade * cycles + robot.age_fade * age
    return robot.rated_energy_j * np.exp(-fade)


def ideal_range(robot: Any) -> Any:
    """Range of a loss-less robot on level ground, E / (C_rr m g), m (Eq. 2).

    >>> import homeward
    >>> round(float(ideal_range(homeward.load_robot("rusti"))))
    72478
    """
    return robot.rated_energy_j / rolling_force(robot)


def composition(parts_w: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Minimum and maximum share of each part in the total power, by the rule of the paper's Table
    III.

    A share is minimal if the part is at its minimum and all others are at their maximum, and vice
    versa. The range that the table prints for sensing, 0.46 to 0.54 %, does not follow from this
    rule.

    Args:
        parts_w: Minimum and maximum power of each part, W.

    >>> rusti_w = {"manoeuvring": (4.8158, 6.8456), "sensing": (0.0293, 0.0348), "radio": (0.165, 0.166),
    ...     "micro-controller": (0.3928, 0.3928)}
    >>> for name, (low, high) in composition(rusti_w).items():
    ...     print(f"{name} {low:.2%} to {high:.2%}")
    manoeuvring 89.03% to 92.10%
    sensing 0.39% to 0.64%
    radio 2.22% to 3.07%
    micro-controller 5.28% to 7.27%
    >>> most_w = sum(most for _, most in rusti_w.values())
    >>> f"{6.8456 / (most_w + 15.0):.1%}"  # manoeuvring beside a 15 W computer, all at their maximum
    '30.5%'
    """
    all_low_w = sum(low_w for low_w, _ in parts_w.values())
    all_high_w = sum(high_w for _, high_w in parts_w.values())
    shares = {}
    for name, (low_w, high_w) in parts_w.items():
        lowest_share = low_w / (low_w + all_high_w - high_w)
        highest_share = high_w / (high_w + all_low_w - low_w)
        shares[name] = lowest_share, highest_share
    return shares
