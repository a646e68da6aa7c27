"""Way home or far side of a loop: by distances and slopes that are met again, or not."""

import numpy as np
import pytest

from homeward.diagnosis.read.way import along_the_way

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
