"""The tilt of a slope sensor is known by ways that close or are driven both ways, and by no
others."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Recording
from homeward.diagnosis.read.pitch import tilt, without_tilt
from homeward.diagnosis.read.signals import Signals, signals
from homeward.logs.channels import Array
from tests.diagnosis.hills import ROBOTS, recordings

TILT_RAD = np.radians(1.5)


def drive(
    husky: Robot,
    base_m: Array,
    tilt_rad: float = TILT_RAD,
    speed_mps: Array | float = 0.5,
    noise_rad: float = 1e-3,
) -> Signals:
    """Over hills, at distances from base, shape (samples,), with a sensor that is tilted."""
    rng = np.random.default_rng(0)
    way = np.gradient(base_m)
    grade = 0.05 * np.sin(base_m / 7.0) * np.where(way < 0.0, -1.0, 1.0) * np.sign(speed_mps)
    return signals(
        Recording("run", "0", {
            "time_s": np.arange(len(base_m)) / 10.0,
            "speed_mps": np.broadcast_to(speed_mps, base_m.shape).copy(),
            "grade_rad": grade + tilt_rad + noise_rad * rng.standard_normal(len(base_m)),
            "base_distance_m": base_m,
            "power_w": 100.0 + rng.standard_normal(len(base_m)),
        }),
        husky,
    )  # fmt: skip


AWAY_M: Array = 0.05 * np.arange(2000.0)
OUT_AND_BACK_M = np.concatenate([AWAY_M, AWAY_M[::-1]])


@pytest.mark.parametrize("start_m", [0.0, 60.0])
@pytest.mark.parametrize("tilt_rad", [TILT_RAD, -TILT_RAD])
def test_a_tilt_is_found_by_a_drive_out_and_back(
    start_m: float, tilt_rad: float, husky: Robot
) -> None:
    """From base or, so that no place near base is met twice, from elsewhere."""
    found = tilt(drive(husky, start_m + OUT_AND_BACK_M, tilt_rad))
    assert found is not None
    assert found[0] == pytest.approx(tilt_rad, abs=np.radians(0.1))
    assert 0.0 < found[1] < np.radians(0.5)


def test_a_way_that_is_driven_once_shows_no_tilt(husky: Robot) -> None:
    assert tilt(drive(husky, 60.0 + AWAY_M)) is None


def test_a_robot_that_backs_home_shows_no_tilt(husky: Robot) -> None:
    """It reads the same slopes on the same ground, tilted or not."""
    there = len(AWAY_M)
    backwards = np.where(np.arange(2 * there) < there, 0.5, -0.5)
    assert tilt(drive(husky, OUT_AND_BACK_M, speed_mps=backwards)) is None


def test_a_way_with_a_gap_shows_no_tilt(husky: Robot) -> None:
    run = drive(husky, OUT_AND_BACK_M)
    assert tilt(run) is not None
    assert tilt(run.only(np.abs(np.arange(len(run.time_s)) - 1000) > 100)) is None


def test_a_run_without_a_place_or_a_slope_shows_no_tilt(husky: Robot) -> None:
    run = drive(husky, OUT_AND_BACK_M)
    for name in ("place_m", "grade_rad"):
        lacks = {other: values for other, values in run.context.items() if other != name}
        assert tilt(dataclasses.replace(run, context=lacks)) is None


def test_slopes_of_all_runs_are_corrected_where_some_show_the_tilt(husky: Robot) -> None:
    away = drive(husky, 60.0 + AWAY_M)
    runs, angle = without_tilt([drive(husky, OUT_AND_BACK_M), away])
    assert angle == pytest.approx(TILT_RAD, abs=np.radians(0.1))
    for after in (runs[1].grade_rad, runs[1].context["grade_rad"]):
        np.testing.assert_allclose(after, away.grade_rad - angle, atol=1e-12)
    assert runs[0].tilt_error_rad == runs[1].tilt_error_rad > 0.0


def test_what_is_not_clear_is_not_corrected_and_may_be_a_tilt(husky: Robot) -> None:
    run = drive(husky, OUT_AND_BACK_M, tilt_rad=1e-4)
    (same,), angle = without_tilt([run])
    assert angle == 0.0
    np.testing.assert_array_equal(same.grade_rad, run.grade_rad)
    found = tilt(run)
    assert found is not None and same.tilt_error_rad == pytest.approx(float(np.hypot(*found)))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("tilt_deg", [0.0, -2.0])
def test_a_tilted_sensor_is_known_by_a_closed_way(name: str, tilt_deg: float) -> None:
    tilted = recordings(
        name, lambda c, rng: {**c, "grade_rad": c["grade_rad"] + np.radians(tilt_deg)}
    )
    level, angle = without_tilt([signals(one, load_robot(name)) for one in tilted])
    assert np.degrees(angle) == pytest.approx(tilt_deg, abs=0.1)
    left_rad = np.radians(tilt_deg) - angle
    assert abs(left_rad) < 3.0 * level[0].tilt_error_rad
