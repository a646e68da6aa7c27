"""Means over windows, and what a robot file predicts for them."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.replay import (
    WithEffects,
    average,
    current_a,
    power_w,
    predict,
    thrust_n_per_a,
    wheels_mps,
)
from homeward.diagnosis.read.signals import Signals, signals
from homeward.logs.channels import Array
from homeward.physics import replay
from homeward.physics.model import rolling_force

TIME_S: Array = np.arange(1200) / 10.0
SPEED_MPS = np.where(TIME_S % 40.0 < 10.0, 0.0, 0.3 + 0.2 * np.sin(TIME_S / 9.0))


def run(husky: Robot, name: str = "run", **channels: Array) -> Signals:
    """A drive with stops, power in proportion to time."""
    given = {"time_s": TIME_S, "speed_mps": SPEED_MPS, "power_w": 10.0 + TIME_S, **channels}
    return signals(Recording(name, name, given), husky)


def test_windows_have_the_means_of_their_samples_run_by_run(husky: Robot) -> None:
    warm = run(husky, "warm", temperature_c=np.full(1200, 25.0))
    runs = average([run(husky), warm])
    count = len(runs.observed) // 2
    assert runs.names == ["run", "warm"] and runs.unit == "W"
    assert runs.run.tolist() == [0] * count + [1] * count
    np.testing.assert_allclose(runs.observed - runs.time_s, 10.0)
    energy_j = float(np.sum(runs.observed * runs.duration_s)) / 2.0
    assert energy_j == pytest.approx(float(np.sum(10.0 + TIME_S) * 0.1))
    assert np.isnan(runs.context["temperature_c"][:count]).all()  # that run lacks it
    np.testing.assert_allclose(runs.context["temperature_c"][count:], 25.0)
    np.testing.assert_array_equal(runs.sensing_hz, 0.0)


def test_windows_hold_as_many_samples_as_they_should(husky: Robot) -> None:
    one = run(husky, time_s=TIME_S[::10], speed_mps=SPEED_MPS[::10], power_w=np.ones(120))
    assert len(average([one]).observed) == 120
    paired = average([one], samples=2)
    assert len(paired.observed) == 60 and paired.duration_s == pytest.approx(np.full(60, 2.0))


def test_the_tilt_of_the_sensor_is_the_least_known_one(husky: Robot) -> None:
    known = [dataclasses.replace(run(husky), tilt_error_rad=error) for error in (0.0, 0.02, 0.01)]
    assert average(known).tilt_error_rad == 0.02


def test_predicted_power_is_that_of_the_model(husky: Robot) -> None:
    grade = 0.05 * np.sin(TIME_S / 11.0)
    one = run(husky, grade_rad=grade)
    model = replay(husky, TIME_S, one.speed_mps, grade_rad=grade, accel_mps2=one.accel_mps2)
    np.testing.assert_allclose(power_w(one, husky), model.power_w)
    predicted = predict(average([one]), husky)
    np.testing.assert_allclose(predicted, model.power_w.reshape(-1, 5).mean(axis=1))


@pytest.mark.parametrize("levels", [(0.0, 10.0), (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)])
def test_a_recorded_load_is_carried(levels: tuple[float, ...], husky: Robot) -> None:
    """Each sample as a robot of that mass draws, also where there are more loads than are
    replayed."""
    load_kg = np.repeat(levels, -(-1200 // len(levels)))[:1200]
    found = power_w(run(husky, payload_kg=load_kg), husky)
    for level in levels:
        heavier = dataclasses.replace(husky, mass_kg=husky.mass_kg + level)
        own = power_w(run(husky), heavier)
        np.testing.assert_allclose(found[load_kg == level], own[load_kg == level])


def test_motor_current_is_thrust_over_the_thrust_of_an_ampere_and_none_at_rest(
    husky: Robot,
) -> None:
    steady = run(husky, speed_mps=np.where(TIME_S < 60.0, 0.0, 0.5))
    found = current_a(steady, dataclasses.replace(husky, rest_current_a=0.3))
    force_n = float(rolling_force(husky)) + husky.drag_ns2_per_m2 * 0.5**2
    assert found[:500] == pytest.approx(0.3)
    assert found[700:] == pytest.approx(0.3 + force_n / thrust_n_per_a(husky))


def test_an_ampere_pushes_less_the_more_is_lost_by_friction(husky: Robot) -> None:
    """What is lost in the motor lowers its voltage."""
    assert thrust_n_per_a(dataclasses.replace(husky, friction_loss=0.0)) == husky.traction_n_per_a
    assert (
        thrust_n_per_a(dataclasses.replace(husky, friction_loss=0.5))
        == husky.traction_n_per_a / 2.0
    )
    assert thrust_n_per_a(dataclasses.replace(husky, motor_loss=0.5)) == thrust_n_per_a(husky)


def test_on_the_spot_the_wheels_turn_too(husky: Robot) -> None:
    turns = run(
        husky, speed_mps=np.where(TIME_S < 60.0, 0.0, -0.4), yaw_rate_radps=np.full(1200, 0.6)
    )
    found = wheels_mps(turns, husky)
    assert found[:500] == pytest.approx(0.3 * husky.track_m)
    assert found[700:] == pytest.approx(0.4)


def test_a_late_instrument_reads_what_was_drawn_before(husky: Robot) -> None:
    runs = average([run(husky)])
    late = predict(runs, husky, met=WithEffects(lag_s=3.0))
    np.testing.assert_allclose(late[6:], predict(runs, husky)[:-6])


def test_true_speeds_are_replayed_where_the_odometer_errs(husky: Robot) -> None:
    """A factor for each run: accelerations err as speeds do."""
    husky = dataclasses.replace(husky, effects={"inertia": {"mass_factor": 1.0}})
    runs = average([run(husky), run(husky, "other")])
    found = predict(runs, husky, met=WithEffects(speed_factors=[1.0, 1.1]))
    one = runs.signals[1]
    faster = dataclasses.replace(
        one, speed_mps=1.1 * one.speed_mps, accel_mps2=1.1 * one.accel_mps2
    )
    np.testing.assert_allclose(found[runs.run == 0], predict(runs, husky)[runs.run == 0])
    np.testing.assert_allclose(found[runs.run == 1], runs.windows[1].means(power_w(faster, husky)))


def test_wind_and_rough_ground_are_met_where_they_are(husky: Robot) -> None:
    robot = dataclasses.replace(
        husky, drag_ns2_per_m2=8.0, effects={"wind": {"exposure": 1.0}, "surface": {"gain": 1.0}}
    )
    runs = average([run(robot)])
    rough = (runs.time_s > 60.0).astype(float)
    moving = np.abs(runs.context["speed_mps"]) > 0.1
    windy = predict(
        runs, robot, met=WithEffects(headwind_mps=[np.full(1200, 3.0)], roughness=0.0 * rough)
    )
    smooth = predict(runs, robot, met=WithEffects(roughness=0.0 * rough))
    bumpy = predict(runs, robot, met=WithEffects(roughness=rough))
    assert (windy[moving] > smooth[moving] + 1.0).all()
    np.testing.assert_allclose(bumpy[runs.time_s < 59.0], smooth[runs.time_s < 59.0])
    assert (
        bumpy[moving & (runs.time_s > 61.0)] > smooth[moving & (runs.time_s > 61.0)] + 1.0
    ).all()
