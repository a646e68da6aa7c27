"""The slope along the way from an elevation, whatever the robot does on it."""

import numpy as np
import pytest

from homeward import load_robot
from homeward.diagnosis.read.slope import slope_along
from homeward.logs.channels import Array
from tests.diagnosis.hills import SAMPLES, STEP_S, drive

CELL_M = 0.5


def along(elevation_m: Array, speed_mps: Array) -> tuple[Array, float]:
    found = slope_along(elevation_m, speed_mps, np.full(len(speed_mps) - 1, STEP_S), CELL_M)
    assert found is not None
    return found


def way_m(speed_mps: Array) -> Array:
    """Place of each sample, negative behind the start."""
    return np.concatenate([[0.0], np.cumsum(speed_mps[:-1] * STEP_S)])


@pytest.mark.parametrize("speed", [0.5, -0.5])
@pytest.mark.parametrize("angle", [0.1, -0.05])
def test_a_ramp_has_its_angle_forwards_and_in_reverse(speed: float, angle: float) -> None:
    speed_mps = np.full(1000, speed)
    slope, error = along(np.tan(angle) * way_m(speed_mps), speed_mps)
    # samples are some per cent of a cell at either end
    np.testing.assert_allclose(slope, angle, rtol=0.05)
    assert float(slope.mean()) == pytest.approx(angle, rel=0.005)
    assert error < 0.05 * abs(angle)


def test_the_slope_changes_its_sign_where_the_robot_turns_round() -> None:
    """Turned round, it drives forwards down what it has climbed, from one moment to the next."""
    speed_mps, there = np.full(2000, 0.5), np.arange(2000) < 1000
    path_m = way_m(speed_mps)
    elevation_m = 0.1 * np.minimum(path_m, path_m[-1] - path_m)
    elevation_m += 0.01 * np.random.default_rng(0).standard_normal(2000)
    slope, _ = along(elevation_m, speed_mps)
    clear = np.abs(path_m - path_m[1000]) > 2.0
    np.testing.assert_allclose(
        slope[clear], np.where(there, 1.0, -1.0)[clear] * np.arctan(0.1), atol=0.02
    )


@pytest.mark.parametrize("kinks", [True, False])
def test_the_slope_keeps_its_sign_where_the_robot_backs_up(kinks: bool) -> None:
    speed_mps = np.where(np.arange(2000) < 1000, 0.5, -0.5)
    elevation_m = 0.1 * way_m(speed_mps) + 0.1 * np.random.default_rng(0).standard_normal(2000)
    found = slope_along(elevation_m, speed_mps, np.full(1999, STEP_S), CELL_M, kinks)
    assert found is not None
    clear = np.abs(np.arange(2000) - 1000) > 20
    np.testing.assert_allclose(found[0][clear], np.arctan(0.1), atol=0.03)


def test_a_stop_does_not_bend_a_ramp() -> None:
    """Nor does it count for more than the way beside it."""
    speed_mps = np.where(np.abs(np.arange(3000) - 1500) < 500, 0.0, 0.5)
    np.testing.assert_allclose(
        along(0.08 * way_m(speed_mps), speed_mps)[0], np.arctan(0.08), rtol=0.06
    )


def test_a_robot_that_stands_adds_no_slope() -> None:
    """Though its noisy elevation goes up and down while it does."""
    rng = np.random.default_rng(0)
    speed_mps = np.where(np.abs(np.arange(3000) - 1500) < 500, 0.0, 0.5)
    slope, _ = along(0.08 * way_m(speed_mps) + 0.02 * rng.standard_normal(3000), speed_mps)
    stands = speed_mps == 0.0
    assert float(slope[stands].mean()) == pytest.approx(0.08, abs=0.02)
    assert float(np.ptp(slope[stands])) < 0.01


@pytest.mark.parametrize("step_m", [0.5, 1.0])
def test_steps_of_a_coarse_elevation_are_no_stairs(step_m: float) -> None:
    """Also of a simulated ramp, whose steps are as regular as rounding allows."""
    speed_mps = np.full(2500, 1.0)
    slope, error = along(step_m * np.round(0.08 * way_m(speed_mps) / step_m), speed_mps)
    np.testing.assert_allclose(slope[250:-250], np.arctan(0.08), atol=0.005)
    assert error < 0.01


def test_heights_that_are_missing_are_bridged() -> None:
    speed_mps = np.full(1000, 0.5)
    elevation_m = np.tan(0.1) * way_m(speed_mps) + 0.05 * np.random.default_rng(0).standard_normal(
        1000
    )
    elevation_m[300:420] = np.nan
    np.testing.assert_allclose(along(elevation_m, speed_mps)[0][300:420], 0.1, atol=0.02)


def test_a_flat_way_is_flat_and_of_a_robot_that_hardly_moves_no_slope_is_known() -> None:
    speed_mps, steps_s = np.full(1000, 0.5), np.full(999, STEP_S)
    slope, error = along(np.full(1000, 412.0), speed_mps)
    assert not slope.any() and error == 0.0
    assert slope_along(np.arange(1000.0), 0.0 * speed_mps, steps_s, CELL_M) is None
    assert slope_along(np.full(1000, np.nan), speed_mps, steps_s, CELL_M) is None


@pytest.mark.parametrize("seed", range(100, 103))
def test_the_slope_from_a_noisy_elevation_is_not_attenuated_and_its_error_is_known(
    seed: int,
) -> None:
    husky = load_robot("husky")
    channels = drive(husky, seed)
    elevation = channels["elevation_m"] + 0.5 * np.random.default_rng(seed).normal(size=SAMPLES)
    found = slope_along(elevation, channels["speed_mps"], np.full(SAMPLES - 1, STEP_S), 0.5)
    assert found is not None
    slope, error = found
    assert np.polyfit(slope, channels["grade_rad"], 1)[0] == pytest.approx(1.0, abs=0.15)
    assert error / 3.0 < float(np.std(slope - channels["grade_rad"])) < 2.0 * error
