"""Way home or far side of a loop: by distances and slopes that are met again, or not."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.way import along_the_way

RIDE = Path(__file__).parents[2] / "envs" / "routes" / "data" / "edge1000_ride.csv.gz"
LENGTH_M = 100.0
REACH_M = 3.0


def hills(place_m: np.ndarray) -> np.ndarray:
    share = 2.0 * np.pi * place_m / LENGTH_M
    return np.asarray(0.05 * np.sin(share + 0.3) + 0.03 * np.cos(2.0 * share))


@pytest.mark.parametrize("noise_m", [0.0, 0.3])
def test_on_a_loop_there_is_no_way_home_and_each_lap_is_the_same_place(noise_m: float) -> None:
    driven_m = np.arange(0.0, 3.5 * LENGTH_M, 0.1)
    place_m = driven_m % LENGTH_M
    base_m = np.abs(
        30.0 * np.sin(np.pi * place_m / LENGTH_M)
        + noise_m * np.random.default_rng(0).normal(size=place_m.size)
    )
    direction, found_m = along_the_way(base_m, driven_m, hills(place_m), REACH_M)
    assert np.mean(direction == 1.0) > 0.95
    away_m = np.abs(found_m - place_m)
    assert np.median(np.minimum(away_m, LENGTH_M - away_m)) < 3.0


@pytest.mark.parametrize("tilt_rad", [0.0, 0.02])
@pytest.mark.parametrize("known", [True, False])
def test_the_way_home_meets_the_slopes_again_reversed(known: bool, tilt_rad: float) -> None:
    driven_m = np.arange(0.0, 3.5 * LENGTH_M, 0.1)
    place_m = LENGTH_M - np.abs(driven_m % (2.0 * LENGTH_M) - LENGTH_M)
    home = driven_m % (2.0 * LENGTH_M) > LENGTH_M
    slope = np.where(home, -1.0, 1.0) * hills(place_m) + tilt_rad
    direction, found_m = along_the_way(place_m, driven_m, slope if known else None, REACH_M)
    assert np.mean((direction < 0.0) == home) > 0.99
    assert np.abs(found_m - place_m).max() < 1.0


def test_a_way_that_bends_back_towards_base_is_still_the_way_out() -> None:
    driven_m = np.arange(0.0, 2.0 * LENGTH_M, 0.1)
    place_m = LENGTH_M - np.abs(driven_m - LENGTH_M)
    base_m = np.interp(place_m, [0.0, 60.0, LENGTH_M], [0.0, 40.0, 30.0])
    slope = np.where(driven_m > LENGTH_M, -1.0, 1.0) * hills(place_m)
    direction, found_m = along_the_way(base_m, driven_m, slope, REACH_M)
    assert np.mean((direction < 0.0) == (driven_m > LENGTH_M)) > 0.95
    assert np.abs(found_m - place_m).max() < 3.0


def test_turns_and_loops_on_the_slopes_of_a_real_ride() -> None:
    """Of ways of a kilometre whose distance from base is the same, so that the slopes decide: they
    have as much noise as is allowed, odometry is off by 1 %, and the far side of a loop over a hill
    may look like a turn."""
    with gzip.open(RIDE, "rt") as file:
        ridden_m, height_m = np.loadtxt(file, delimiter=",", skiprows=4).T
    grid_m = np.arange(0.0, ridden_m.max(), 5.0)
    smooth_m = gaussian_filter1d(np.interp(grid_m, ridden_m, height_m), 6.0)  # over 30 m
    slope = np.gradient(smooth_m, grid_m)
    length_m = 1000.0
    driven_m = np.arange(0.0, length_m, 2.0)
    base_m = 300.0 * np.sin(np.pi * driven_m / length_m)
    home = driven_m > 0.5 * length_m
    rng = np.random.default_rng(0)
    turns: list[bool] = []
    loops: list[bool] = []
    for start_m in np.arange(0.0, grid_m[-1] - length_m, 500.0):
        place_m = np.where(home, length_m - 1.01 * driven_m, driven_m)
        way = 1.0 - 2.0 * home
        noise = np.sqrt(thresholds.UNCLEAR) * slope.std() * rng.normal(size=len(driven_m))
        there_and_back = way * np.interp(start_m + place_m, grid_m, slope) + noise
        around = np.interp(start_m + driven_m, grid_m, slope)
        for slopes, results in ((there_and_back, turns), (around - around.mean(), loops)):
            direction, _ = along_the_way(base_m, driven_m, slopes, reach_m=10.0)
            results.append(bool(np.mean(direction[home]) < 0.0))
    assert np.mean(turns) > 0.9  # 94 %
    assert np.mean(loops) < 0.22  # 18 %
