"""The way out and home: hills, patches, bends, wind and pace, and the power that they cost at the
terminals.

The way is cut into cells that the robot crosses in about a second. Forces of all cells are computed
once, as arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from benchmarks.on_the_robot.gauges.cell import Floats
from benchmarks.on_the_robot.gauges.robots import TrueRobot
from benchmarks.on_the_robot.gauges.sizes import Sizes, between

GRAVITY_MPS2 = 9.81
CELL_S = 1.0  # s, chosen: time to cross a cell at cruise


@dataclass(frozen=True)
class Ground:
    """A way from home, in cells of equal length; every array has the shape (cells,).

    Attributes:
        length_m: Length of a cell.
        grade_rad: Slope on the way out, uphill positive.
        heading_rad: Direction on the way out, counter-clockwise from east.
        east_m, north_m: End of each cell; home is the origin.
        out_mps, home_mps: Speed on the way out and home.
        out_w, home_w: Power at the terminals with gusts and the wander of standby power.
        mean_home_w: Power on the way home with the mean wind and mean standby power.
        stop_s: Time for which the robot stops in a cell on the way out.
        standby_w: Mean standby power.
    """

    length_m: float
    grade_rad: Floats
    heading_rad: Floats
    east_m: Floats
    north_m: Floats
    out_mps: Floats
    home_mps: Floats
    out_w: Floats
    home_w: Floats
    mean_home_w: Floats
    stop_s: Floats
    standby_w: float


def draw_ground(
    robot: TrueRobot, grade_sd_rad: list[float], seconds: float, sizes: Sizes, rng: Generator
) -> Ground:
    """Draw a way that the robot would need `seconds` to drive out."""
    cells = int(seconds / CELL_S)
    grade_rad = _waves(cells, sizes, rng) * between(rng.random(), grade_sd_rad)
    main_rad = rng.uniform(-np.pi, np.pi)
    heading_rad = main_rad + _waves(cells, sizes, rng) * sizes.ground.bend_rad
    length_m = robot.cruise_mps * CELL_S
    rolling = robot.rolling_resistance * _patches(cells, sizes, rng)
    wind_mps = between(rng.random(), sizes.truth.wind_mps)
    wind_from_rad = rng.uniform(-np.pi, np.pi)

    out_mps = _pace(robot, grade_rad, sizes, rng)
    home_mps = _pace(robot, -grade_rad, sizes, rng)
    out_gust = 1.0 + sizes.truth.gust_share * _wander(cells, sizes.truth.gust_s, rng)
    home_gust = 1.0 + sizes.truth.gust_share * _wander(cells, sizes.truth.gust_s, rng)
    out_standby_w = robot.standby_w * (1.0 + _standby_wander(cells, sizes, rng))
    home_standby_w = robot.standby_w * (1.0 + _standby_wander(cells, sizes, rng))
    # Headwind on the way out; on the way home it is the opposite.
    against_mps = wind_mps * np.cos(wind_from_rad - heading_rad)
    across_mps = wind_mps * np.sin(wind_from_rad - heading_rad)

    out_traction_w = traction_w(
        robot, grade_rad, rolling, out_mps, against_mps * out_gust, across_mps * out_gust
    )
    home_traction_w = traction_w(
        robot, -grade_rad, rolling, home_mps, -against_mps * home_gust, across_mps * home_gust
    )
    mean_traction_w = traction_w(robot, -grade_rad, rolling, home_mps, -against_mps, across_mps)
    return Ground(
        length_m=length_m,
        grade_rad=grade_rad,
        heading_rad=heading_rad,
        east_m=np.cumsum(length_m * np.cos(heading_rad)),
        north_m=np.cumsum(length_m * np.sin(heading_rad)),
        out_mps=out_mps,
        home_mps=home_mps,
        out_w=out_traction_w + out_standby_w,
        home_w=home_traction_w + home_standby_w,
        mean_home_w=mean_traction_w + robot.standby_w,
        stop_s=_stops(cells, sizes, rng),
        standby_w=robot.standby_w,
    )


def traction_w(
    robot: TrueRobot,
    grade_rad: Floats,
    rolling: Floats,
    speed_mps: Floats,
    against_mps: Floats,
    across_mps: Floats,
) -> Floats:
    """Power of the motors at the terminals, W, shape (cells,); braking downhill returns nothing.

    Air drags along the direction of the air past the robot, so that side wind costs energy, too.
    """
    past_mps = speed_mps + against_mps
    air_mps = np.hypot(past_mps, across_mps)
    drag_n = robot.drag_ns2_per_m2 * air_mps * past_mps
    weight_n = robot.mass_kg * GRAVITY_MPS2
    rolling_n = rolling * weight_n * np.cos(grade_rad)
    force_n = rolling_n + weight_n * np.sin(grade_rad) + drag_n
    wheel_w = np.maximum(force_n * speed_mps, 0.0)
    copper_w = robot.copper_w_per_n2 * force_n**2
    power_w: Floats = wheel_w * (1.0 + robot.gear_loss) + copper_w
    return power_w


def home_energy_j(ground: Ground) -> Floats:
    """True energy of the way home from each cell's end, J, shape (cells,): with the mean wind,
    without the turn."""
    energy_j: Floats = np.cumsum(ground.mean_home_w * ground.length_m / ground.home_mps)
    return energy_j


def _waves(cells: int, sizes: Sizes, rng: Generator) -> Floats:
    """A sum of sines with random lengths and phases and a standard deviation of 1, shape
    (cells,)."""
    low_s, high_s = np.log(sizes.ground.wave_s)
    periods_s = np.exp(rng.uniform(low_s, high_s, sizes.ground.waves))
    phases_rad = rng.uniform(0.0, 2.0 * np.pi, sizes.ground.waves)
    times_s = CELL_S * np.arange(cells)
    total = np.zeros(cells)
    for period_s, phase_rad in zip(periods_s, phases_rad, strict=True):
        total += np.sin(2.0 * np.pi * times_s / period_s + phase_rad)
    scaled: Floats = total / np.sqrt(sizes.ground.waves / 2.0)
    return scaled


def _patches(cells: int, sizes: Sizes, rng: Generator) -> Floats:
    """Factors of rolling resistance with a mean of about 1, constant on each patch, shape
    (cells,)."""
    starts = rng.random(cells) < CELL_S / sizes.ground.patch_s
    patch = np.cumsum(starts)
    log_factors = rng.normal(-0.5 * sizes.ground.patch_sd**2, sizes.ground.patch_sd, patch[-1] + 1)
    factors: Floats = np.exp(log_factors[patch])
    return factors


def _wander(cells: int, correlation_s: float, rng: Generator) -> Floats:
    """Noise with a standard deviation of 1 that forgets itself after `correlation_s`, shape
    (cells,)."""
    share_kept = np.exp(-CELL_S / correlation_s)
    noise = rng.normal(0.0, np.sqrt(1.0 - share_kept**2), cells)
    wander: Floats = lfilter([1.0], [1.0, -share_kept], noise)
    return wander


def _standby_wander(cells: int, sizes: Sizes, rng: Generator) -> Floats:
    """Relative deviation of standby power from its mean, shape (cells,)."""
    return sizes.truth.standby_wander * _wander(cells, sizes.truth.standby_wander_s, rng)


def _pace(robot: TrueRobot, grade_rad: Floats, sizes: Sizes, rng: Generator) -> Floats:
    """Speed, m/s, shape (cells,): slower uphill, and never quite steady."""
    slowdown = sizes.truth.uphill_slowdown * np.maximum(grade_rad, 0.0)
    wander = sizes.truth.speed_wander * _wander(grade_rad.size, sizes.truth.gust_s, rng)
    factor = np.clip(1.0 - slowdown + wander, 0.4, 1.15)
    speed_mps: Floats = robot.cruise_mps * factor
    return speed_mps


def _stops(cells: int, sizes: Sizes, rng: Generator) -> Floats:
    """Time for which the robot stops in each cell, s, shape (cells,)."""
    stops_here = rng.random(cells) < sizes.ground.stops_per_hour * CELL_S / 3600.0
    low_s, high_s = sizes.ground.stop_s
    stop_s: Floats = np.where(stops_here, rng.uniform(low_s, high_s, cells), 0.0)
    return stop_s
