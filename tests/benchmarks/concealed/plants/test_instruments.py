"""Instruments of the concealed plants: what they read, their noise, and what each fault does to a
log."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from benchmarks.concealed.plants.chain import Work
from benchmarks.concealed.plants.instruments import (
    FAULTS,
    NOISES,
    Logging,
    NoiseLevel,
    read_power,
    record,
)
from benchmarks.concealed.plants.vehicles import SCOUT, typical_power_w
from tests.benchmarks.concealed.plants.steady import DT_S, ROBOT, motion, plain

SILENT = NoiseLevel(*(0.0 for _ in dataclasses.fields(NoiseLevel)))
SPEED = np.where(np.arange(600) < 100, 0.0, 1.0)
HEIGHT = np.linspace(0.0, 7.3, 600)


def driven(read_by: str = "gauge") -> Work:
    run = motion(SPEED, elevation_m=HEIGHT, grade_rad=0.02, yaw_rate_radps=0.1, sensing_hz=5.0)  # type: ignore[arg-type]
    return plain(run, read_by=read_by)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def clean(work: Work, logging: Logging | None = None) -> pd.DataFrame:
    return record(work, SILENT, logging or Logging(), rng())


def faulty(name: str, work: Work, level: float = 0.5) -> pd.DataFrame:
    return FAULTS[name](clean(work), work, level, rng())


def test_without_noise_the_log_is_the_truth() -> None:
    work = driven()
    frame = clean(work)
    for name, truth in (
        ("time_s", work.run.time_s), ("speed_mps", SPEED), ("grade_rad", work.run.grade_rad),
        ("yaw_rate_radps", work.run.yaw_rate_radps), ("power_w", work.seen_w), ("soc", work.soc),
        ("distance_m", work.run.distance_m), ("base_distance_m", work.run.base_distance_m),
        ("temperature_c", work.run.temperature_c), ("sensing_hz", work.run.sensing_hz),
    ):  # fmt: skip
        np.testing.assert_allclose(frame[name], truth, err_msg=name)


def test_voltage_times_current_is_the_power_at_the_terminals() -> None:
    work = driven("terminals")
    frame = clean(work)
    assert "power_w" not in frame
    np.testing.assert_allclose(frame["voltage_v"] * frame["current_a"], work.power_w)


def test_wheels_turn_for_the_speed_and_the_bend() -> None:
    frame = clean(driven(), Logging(wheels=True))
    assert not {"speed_mps", "yaw_rate_radps"} & set(frame)
    np.testing.assert_allclose(
        0.5 * (frame["wheel_left_mps"] + frame["wheel_right_mps"]), SPEED, atol=1e-12
    )
    np.testing.assert_allclose(
        (frame["wheel_right_mps"] - frame["wheel_left_mps"]) / ROBOT.track_m, 0.1
    )


@pytest.mark.parametrize(
    ("logging", "there", "absent"),
    [
        (Logging(elevation=True), {"elevation_m"}, {"grade_rad"}),
        (Logging(grade=False), set(), {"grade_rad", "elevation_m"}),
        (Logging(distance=False), set(), {"distance_m"}),
        (Logging(charge=False), set(), {"soc"}),
    ],
)
def test_a_log_has_the_columns_that_are_logged(
    logging: Logging, there: set[str], absent: set[str]
) -> None:
    columns = set(clean(driven(), logging))
    assert there <= columns and not absent & columns


@pytest.mark.parametrize("level", NOISES)
def test_noise_is_as_large_as_its_level_says_and_none_is_on_a_vehicle_that_stands(
    level: str,
) -> None:
    noise, work = NOISES[level], plain(motion(1.0, 3000.0))
    frame = record(work, noise, Logging(), rng())
    for name, truth, deviation in (
        ("power_w", work.seen_w, noise.power_share * typical_power_w(SCOUT)),
        ("speed_mps", work.run.speed_mps, noise.speed_share * ROBOT.max_speed_mps),
        ("grade_rad", work.run.grade_rad, noise.grade_rad),
        ("temperature_c", work.run.temperature_c, noise.temperature_c),
        ("soc", work.soc, noise.charge_share),
    ):
        error = frame[name] - truth
        assert error.std() == pytest.approx(deviation, rel=0.03), name
        assert error.mean() == pytest.approx(0.0, abs=4.0 * deviation / np.sqrt(len(frame))), name
    assert (record(plain(motion(0.0)), noise, Logging(), rng())["speed_mps"] == 0.0).all()


def test_noise_grows_from_level_to_level() -> None:
    low, middle, high = (dataclasses.astuple(NOISES[level]) for level in ("low", "middle", "high"))
    assert all(a < b < c for a, b, c in zip(low, middle, high, strict=True))


def test_a_reading_has_gain_offset_and_lag() -> None:
    work = driven()
    work.seen_w = 2.0 * work.run.time_s
    work.read_gain, work.read_offset_w, work.read_lag_s = (
        work.read_gain * 1.5,
        work.read_offset_w + 7.0,
        3.0,
    )
    late_s = np.maximum(work.run.time_s - 3.0, 0.0)  # the first reading is held
    np.testing.assert_allclose(read_power(work), 1.5 * 2.0 * late_s + 7.0)


def test_a_smoothed_reading_follows_a_ramp_by_its_time_constant() -> None:
    work = driven()
    work.seen_w, work.read_smooth_s = 2.0 * work.run.time_s, 0.5
    assert work.seen_w[-1] - read_power(work)[-1] == pytest.approx(2.0 * 0.5, abs=0.15)


def test_elevation_faults_are_noise_steps_and_delay() -> None:
    work = driven()
    noisy = faulty("noisy_elevation", work)["elevation_m"] - HEIGHT
    assert noisy.std() == pytest.approx(0.5, rel=0.1)
    stepped = faulty("stepped_elevation", work)["elevation_m"].to_numpy()
    np.testing.assert_array_equal(stepped, stepped.round())
    late = faulty("late_elevation", work)["elevation_m"].to_numpy() - HEIGHT
    assert late[200:].mean() == pytest.approx(-7.3 / 599 * 100, abs=0.02)  # 10 s of the climb
    for name in ("noisy_elevation", "stepped_elevation", "late_elevation"):
        assert "grade_rad" not in faulty(name, work)


def test_grade_faults_are_noise_an_angle_and_nothing() -> None:
    work = driven()
    assert (faulty("noisy_grade", work)["grade_rad"] - 0.02).std() == pytest.approx(
        np.radians(0.7), rel=0.1
    )
    for level, degrees in ((0.0, 0.5), (1.0, 2.0)):
        np.testing.assert_allclose(
            faulty("pitched_imu", work, level)["grade_rad"] - 0.02, np.radians(degrees)
        )
    assert not {"grade_rad", "elevation_m"} & set(faulty("no_grade", work))


def test_a_noisy_speed_is_noisy_while_it_stands_and_never_negative() -> None:
    speed = faulty("noisy_speed", driven())["speed_mps"]
    assert speed.min() >= 0.0 and speed[SPEED == 0.0].max() > 0.0
    assert (speed - SPEED)[SPEED > 0.0].std() == pytest.approx(0.04 * ROBOT.max_speed_mps, rel=0.1)
    work = driven()
    wheels = FAULTS["noisy_speed"](clean(work, Logging(wheels=True)), work, 0.5, rng())
    np.testing.assert_allclose(
        (wheels["wheel_right_mps"] - wheels["wheel_left_mps"]) / ROBOT.track_m, 0.1
    )


def test_held_values_change_seldom_and_are_values_that_were() -> None:
    work = driven()
    truth, held = clean(work), faulty("held_values", work)
    np.testing.assert_array_equal(held["time_s"], truth["time_s"])
    held_j = np.flatnonzero(np.diff(held["distance_m"]))
    assert np.diff(held_j).min() >= round(0.5 / DT_S)
    assert set(held["power_w"]) <= set(truth["power_w"])


@pytest.mark.parametrize(("level", "drift_s"), [(0.0, 0.2), (1.0, 2.0)])
def test_a_clock_drifts_from_nothing_to_its_end(level: float, drift_s: float) -> None:
    work = driven()
    work.seen_w = work.run.time_s.copy()
    drifted = FAULTS["drifting_clock"](clean(work), work, level, rng())["power_w"].to_numpy()
    error = drifted - work.run.time_s
    assert error[0] == 0.0
    assert abs(error[300]) == pytest.approx(drift_s * work.run.time_s[300] / work.run.time_s[-1])


@pytest.mark.parametrize("read_by", ["gauge", "terminals"])
def test_a_charger_fills_the_battery_while_the_vehicle_stands(read_by: str) -> None:
    work = driven(read_by)
    frame = faulty("charging", work)
    tail = frame[len(work.run.time_s) :]
    power_w = tail["power_w"] if read_by == "gauge" else tail["voltage_v"] * tail["current_a"]
    assert (power_w < 0.0).all() and (np.diff(frame["time_s"]) > 0.0).all()
    assert power_w.iloc[0] == pytest.approx(-0.8 * typical_power_w(SCOUT), rel=0.05)
    assert abs(power_w.iloc[-1]) < abs(power_w.iloc[0])
    assert (np.diff(tail["soc"]) >= 0.0).all() and tail["soc"].iloc[-1] > work.soc[-1]
    gained_j = (tail["soc"].iloc[-1] - work.soc[-1]) * ROBOT.rated_energy_j
    assert gained_j == pytest.approx(-power_w.sum() * DT_S, rel=1e-6)


@pytest.mark.parametrize(("read_by", "column"), [("gauge", "power_w"), ("terminals", "current_a")])
def test_a_wrong_sign_is_of_the_power_or_the_current(read_by: str, column: str) -> None:
    work = driven(read_by)
    truth, wrong = clean(work), faulty("wrong_sign", work)
    np.testing.assert_array_equal(wrong[column], -truth[column])
    pd.testing.assert_frame_equal(wrong.drop(columns=column), truth.drop(columns=column))


def test_spikes_are_few_and_far_above_anything_real() -> None:
    work = plain(motion(1.0, 1000.0))
    truth, spiked = clean(work), faulty("spikes", work)
    hit = spiked["power_w"] != truth["power_w"]
    assert 0.0005 < hit.mean() < 0.004
    assert spiked["power_w"][hit].min() >= 3.0 * truth["power_w"].max()


def test_gaps_leave_out_whole_rows() -> None:
    work = driven()
    truth, left = clean(work), faulty("gaps", work)
    assert 0.0 < len(left) / len(truth) < 1.0 and list(left.index) == list(range(len(left)))
    assert np.diff(left["time_s"]).max() > 1.9
    assert set(left["time_s"]) <= set(truth["time_s"])


def test_a_reset_odometer_begins_again_and_the_meter_reads_nothing_meanwhile() -> None:
    work = driven()
    truth, reset = clean(work), faulty("resets", work)
    at = int(np.argmin(np.diff(reset["distance_m"]))) + 1
    assert reset["distance_m"][at] == 0.0 < truth["distance_m"][at]
    np.testing.assert_allclose(
        np.diff(reset["distance_m"][at:]), np.diff(truth["distance_m"][at:]), atol=1e-12
    )
    silent = reset["power_w"] == 0.0
    assert silent[at] and 1.0 <= silent.sum() * DT_S <= 2.2
    np.testing.assert_array_equal(reset["power_w"][~silent], truth["power_w"][~silent])


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_a_copy(name: str) -> None:
    work = driven()
    frame, before = clean(work), clean(work)
    FAULTS[name](frame, work, 0.5, rng())
    pd.testing.assert_frame_equal(frame, before)
