"""Test drives: every robot can drive them, and what changes in one changes its simulated power."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis.explain.menu import KNOWN_MASS, MENU, SAMPLES, Drive, Manoeuvre
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import WithEffects, average
from homeward.physics import preset_names

NAMED = {one.id: one for one in MENU}


def drive(fit: Refit, manoeuvre: Manoeuvre) -> Drive:
    return Drive(fit, manoeuvre, "W", 20.0)


@pytest.mark.parametrize("name", sorted(preset_names()))
def test_every_robot_can_drive_every_manoeuvre(name: str) -> None:
    robot = load_robot(name)
    for manoeuvre in MENU:
        course = manoeuvre.signals(robot, "W", 20.0)
        assert len(course.time_s) == SAMPLES and (np.diff(course.time_s) > 0.0).all()
        assert np.abs(course.speed_mps).max() <= robot.max_speed_mps
        assert course.sensing_hz.min() >= 0.0 and course.sensing_hz.max() <= robot.max_sensing_hz
        of_current = manoeuvre.signals(robot, "A", 20.0)
        assert len(average([course]).observed) == len(average([of_current]).observed) == SAMPLES
        assert manoeuvre.sentence[0].islower() and not manoeuvre.sentence.endswith(".")
    assert len(NAMED) == len(MENU)


def test_no_wind_blows_along_the_way_unless_the_drive_goes_both_ways(husky: Robot) -> None:
    straight = NAMED["three_speeds"].signals(husky, "W", 20.0)
    np.testing.assert_allclose(np.cos(straight.context["heading_rad"]), 0.0, atol=1e-12)
    both = NAMED["both_ways"].signals(husky, "W", 20.0)
    along_mps = np.cos(both.context["heading_rad"]) * both.speed_mps
    assert set((along_mps / husky.max_speed_mps).tolist()) == {-1.0, -0.5, 0.5, 1.0}


def test_a_turning_robot_heads_where_it_has_turned_to(husky: Robot) -> None:
    spot = dataclasses.replace(NAMED["on_the_spot"], step_s=2.0).signals(husky, "W", 20.0)
    turned_rad = np.diff(spot.context["heading_rad"])
    np.testing.assert_allclose(turned_rad, (spot.yaw_rate_radps * np.gradient(spot.time_s))[1:])
    wheels_mps = 0.5 * husky.track_m * np.abs(spot.yaw_rate_radps)
    assert wheels_mps.max() == pytest.approx(0.5 * husky.max_speed_mps)
    assert (spot.speed_mps == 0.0).all()
    loop = NAMED["other_ground"].signals(husky, "W", 20.0)
    np.testing.assert_allclose(
        np.gradient(loop.context["heading_rad"], loop.time_s), loop.yaw_rate_radps, rtol=0.01
    )


def test_a_known_mass_is_more_of_the_mass_and_of_what_rolls(short_fit: Refit) -> None:
    loaded = drive(short_fit, dataclasses.replace(NAMED["known_mass"], grade_rad=0.05))
    on_top = np.greater(NAMED["known_mass"].known_mass, 0.0)
    heavier = short_fit.theta.copy()
    heavier[MASS] += KNOWN_MASS * short_fit.parameters.nominal.mass_kg
    heavier[ROLLING] *= heavier[MASS] / short_fit.theta[MASS]  # C_rr stays as it is
    np.testing.assert_allclose(
        loaded.plain[on_top], short_fit.parameters.predict(loaded.runs, heavier)[on_top]
    )
    np.testing.assert_allclose(
        loaded.plain[~on_top], short_fit.parameters.predict(loaded.runs, short_fit.theta)[~on_top]
    )
    assert loaded.plain[on_top].mean() > loaded.plain[~on_top].mean()


def test_what_is_switched_off_draws_nothing(short_fit: Refit) -> None:
    switched = drive(short_fit, NAMED["on_and_off"])
    on = np.equal(NAMED["on_and_off"].switched_on, 1.0)
    assert (switched.plain[~on] == 0.0).all() and (switched.plain[on] > 0.0).all()


def test_the_cold_of_a_morning_and_the_mean_of_the_recordings_are_driven_in(husky: Robot) -> None:
    assert set(NAMED["cold_and_warm"].signals(husky, "W", 12.0).temperature_c) == {0.0, 30.0}
    assert set(NAMED["slope"].signals(husky, "W", 12.0).temperature_c) == {12.0}


@pytest.mark.parametrize(
    ("manoeuvre", "what", "present"),
    [
        ("slope", "route", {0.0}),  # on slopes of known angle, a hidden one of the route is not met
        ("long_pause", "route", {1.0}),
        ("slope", "ground", {1.0}),
        ("other_ground", "ground", {0.0, 1.0}),
        ("known_mass", "load", {0.0, 1.0}),
        ("slope", None, {1.0}),
    ],
)
def test_a_drive_has_the_load_ground_and_route_that_it_says(
    short_fit: Refit, manoeuvre: str, what: str | None, present: set[float]
) -> None:
    assert set(np.ravel(drive(short_fit, NAMED[manoeuvre]).there(what))) == present


def test_an_effect_adds_to_the_power_of_the_drive_that_excites_it(short_fit: Refit) -> None:
    turning = WithEffects({"turning": {"scrub": 0.3}})
    straight, spot = (drive(short_fit, NAMED[one]) for one in ("three_speeds", "on_the_spot"))
    np.testing.assert_allclose(straight.predict(short_fit.theta, turning), straight.plain)
    assert spot.predict(short_fit.theta, turning).mean() > 1.05 * spot.plain.mean()


def test_a_robot_without_a_track_turns_at_a_rate_of_its_own(husky: Robot) -> None:
    trackless = dataclasses.replace(husky, track_m=0.0)
    rate = NAMED["on_the_spot"].signals(trackless, "W", 20.0).yaw_rate_radps
    assert np.isfinite(rate).all() and np.abs(rate).max() == pytest.approx(1.0)
