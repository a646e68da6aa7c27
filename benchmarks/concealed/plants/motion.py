"""Motion of a vehicle: routes with hills and bends, speeds, stops, turns, sensing rates, and air
temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from benchmarks.concealed.plants.vehicles import Plant

Array = NDArray[np.float64]
_POINTS = 2000  # of a route


@dataclass(frozen=True)
class Course:
    """A route driven out and back, or in a loop: elevation and heading by place along it."""

    length_m: float
    loop: bool
    elevation: CubicSpline
    curvature_per_m: CubicSpline
    heading_rad: float


@dataclass
class Motion:
    """True motion of one drive, shape (n,) each."""

    time_s: Array
    speed_mps: Array
    accel_mps2: Array
    grade_rad: Array
    yaw_rate_radps: Array
    heading_rad: Array
    place_m: Array  # along the route, so that the way home passes the same places
    direction: Array  # 1 on the way out, -1 on the way home
    distance_m: Array  # travelled
    elevation_m: Array
    base_distance_m: Array  # straight line to the start of the drive
    sensing_hz: Array
    temperature_c: Array
    day_s: float  # start of the drive since the first one
    index: int  # of the drive within its case

    @property
    def dt_s(self) -> float:
        """Step, s."""
        return float(self.time_s[1] - self.time_s[0])


def make_route(vehicle: Plant, rng: Generator) -> Course:
    """Draw a route: hills as a periodic spline with the steepest slope of the vehicle; bends as
    another spline."""
    loop = bool(rng.random() < 0.4)
    length_m = vehicle.leg_m * rng.uniform(0.7, 1.4) * (2.0 if loop else 1.0)
    knots = int(rng.integers(4, 10))
    at_m = np.linspace(0.0, length_m, knots + 1)
    height = rng.normal(size=knots + 1)
    height[-1] = height[0]
    hills = CubicSpline(at_m, height, bc_type="periodic")
    slope = np.abs(hills(np.linspace(0.0, length_m, 400), 1)).max()
    steepest = vehicle.steepest_grade_rad * rng.uniform(0.5, 1.0)
    elevation = CubicSpline(at_m, height * steepest / slope, bc_type="periodic")
    bend = rng.normal(size=knots + 1) * rng.uniform(0.5, 2.0) / (length_m / 6.0)
    bend += (2.0 * np.pi / length_m if loop else 0.0) - bend[:-1].mean()
    bend[-1] = bend[0]
    return Course(
        length_m,
        loop,
        elevation,
        CubicSpline(at_m, bend, bc_type="periodic"),
        rng.uniform(0.0, 2.0 * np.pi),
    )


def _levels(
    rng: Generator, duration_s: float, dt_s: float, values: Array, least_s: float, most_s: float
) -> Array:
    """Hold drawn values for drawn times, shape (n,)."""
    n = round(duration_s / dt_s)
    level = np.empty(n)
    start = 0
    while start < n:
        end = start + max(1, round(rng.uniform(least_s, most_s) / dt_s))
        level[start:end] = rng.choice(values)
        start = end
    return level


def _speeds(vehicle: Plant, rng: Generator, duration_s: float, dt_s: float) -> Array:
    """Speeds with stops, with a random limit of acceleration, at standstill first and last, m/s."""
    top_mps = vehicle.robot.max_speed_mps
    wanted = _levels(
        rng, duration_s, dt_s, top_mps * np.array([0.25, 0.4, 0.55, 0.7, 0.85, 1.0]), 15.0, 50.0
    )
    for start_s in np.arange(rng.uniform(30.0, 60.0), duration_s, rng.uniform(60.0, 120.0)):
        end_s = start_s + rng.uniform(6.0, 25.0)
        wanted[round(start_s / dt_s) : round(end_s / dt_s)] = 0.0
    wanted[: round(8.0 / dt_s)] = 0.0
    largest_step_mps = vehicle.max_accel_mps2 * rng.uniform(0.4, 1.0) * dt_s
    brake_s = top_mps / largest_step_mps * dt_s
    standing_s = 8.0 + min(brake_s, 20.0)
    wanted[-round(standing_s / dt_s) :] = 0.0
    speed = np.zeros(wanted.size)
    for i in range(1, speed.size):
        speed[i] = speed[i - 1] + np.clip(
            wanted[i] - speed[i - 1], -largest_step_mps, largest_step_mps
        )
    return speed


def drive(vehicle: Plant, route: Course, rng: Generator, index: int, day_s: float, mean_c: float, dt_s: float,
          duration_s: float) -> Motion:  # fmt: skip
    """Drive along a route for some time, with turns on the spot (or U-turns) at its ends."""
    speed = _speeds(vehicle, rng, duration_s, dt_s)
    n = speed.size
    time = np.arange(n, dtype=np.float64) * dt_s
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * dt_s)])
    lap, into = np.divmod(distance, route.length_m)
    home = (lap % 2 == 1) & (not route.loop)
    direction = np.where(home, -1.0, 1.0)
    place = np.where(home, route.length_m - into, into)
    grade = np.arcsin(route.elevation(place, 1)) * direction
    yaw = route.curvature_per_m(place) * speed * direction
    # the half turn at an end takes some seconds; vehicles that can turn on the spot do
    if not route.loop:
        for end in np.flatnonzero(np.diff(lap)):
            turn_s = max(np.pi / (0.7 * vehicle.max_turn_radps), 2.0 * dt_s)
            turn = slice(end, min(n, end + round(turn_s / dt_s)))
            yaw[turn] += np.pi / turn_s
    if vehicle.steering != "ackermann":  # looks around while it stands
        for start in np.flatnonzero((speed[1:] == 0.0) & (speed[:-1] > 0.0)):
            if rng.random() < 0.6:
                stop = slice(start + round(2.0 / dt_s), start + round(rng.uniform(4.0, 7.0) / dt_s))
                turning_radps = rng.choice([-1.0, 1.0]) * 0.6 * vehicle.max_turn_radps
                yaw[stop] += np.where(speed[stop] == 0.0, turning_radps, 0.0)
    yaw = np.clip(yaw, -vehicle.max_turn_radps, vehicle.max_turn_radps)
    heading = np.mod(route.heading_rad + np.cumsum(yaw) * dt_s, 2.0 * np.pi)
    hz = vehicle.robot.max_sensing_hz * np.array([0.0, 0.2, 0.5, 1.0])
    # the first drive starts at six
    since_midnight = 2.0 * np.pi * (21600.0 + day_s + time) / 86400.0
    swing_c = 8.0 if vehicle.outdoor else 1.5
    return Motion(
        time_s=time, speed_mps=speed, accel_mps2=np.gradient(speed, dt_s), grade_rad=grade, yaw_rate_radps=yaw,
        heading_rad=heading, place_m=place, direction=direction, distance_m=distance,
        elevation_m=route.elevation(place), base_distance_m=_from_start(route, place),
        sensing_hz=_levels(rng, duration_s, dt_s, hz, 20.0, 90.0),
        temperature_c=mean_c - swing_c * np.cos(since_midnight), day_s=day_s, index=index,
    )  # fmt: skip


def _from_start(route: Course, place_m: Array) -> Array:
    """Straight line from the start of a route to places along it, m; a loop ends where it
    begins."""
    at_m = np.linspace(0.0, route.length_m, _POINTS)
    course = route.heading_rad + route.curvature_per_m.antiderivative()(at_m)
    along_m = cumulative_trapezoid(np.cos(course), at_m, initial=0)
    across_m = cumulative_trapezoid(np.sin(course), at_m, initial=0)
    if route.loop:
        along_m -= along_m[-1] * at_m / route.length_m
        across_m -= across_m[-1] * at_m / route.length_m
    return np.asarray(
        np.hypot(np.interp(place_m, at_m, along_m), np.interp(place_m, at_m, across_m))
    )


def make_drives(vehicle: Plant, routes: list[Course], rng: Generator, runs_wanted: int, mean_c: float,
                short: bool = False) -> list[Motion]:  # fmt: skip
    """Draw drives over one day, on the routes in turn."""
    dt_s = 1.0 / float(rng.choice([5.0, 10.0, 20.0], p=[0.4, 0.45, 0.15]))
    runs = []
    day_s = 0.0
    for index in range(runs_wanted):
        duration_s = rng.uniform(60.0, 90.0) if short else rng.uniform(120.0, 720.0)
        runs.append(
            drive(vehicle, routes[index % len(routes)], rng, index, day_s, mean_c, dt_s, duration_s)
        )
        day_s += duration_s + rng.uniform(600.0, 9000.0)
    return runs
