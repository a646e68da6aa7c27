"""Groups are what recordings determine: their robot, bounds, predictions and derivatives."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis.fit.estimates import estimates
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.parameter_groups import (
    AT_REST,
    DRAG,
    MASS,
    ROLLING,
    derivatives,
    parameters,
    with_ancillary,
    with_effects_of,
)
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, WithEffects, predict
from homeward.physics import ancillary_power, preset_names


def of_current(runs: Runs, amperes_per_watt: float = 0.01) -> Runs:
    """The same runs, had motor current been recorded."""
    signals = [dataclasses.replace(run, unit="A") for run in runs.signals]
    return dataclasses.replace(
        runs, unit="A", signals=signals, observed=amperes_per_watt * runs.observed
    )


def test_groups_over_another_efficiency_are_the_same_groups(husky: Robot, short_runs: Runs) -> None:
    lossy = dataclasses.replace(husky, motor_loss=0.2, friction_loss=0.06)
    problem = parameters(short_runs, lossy)
    less = problem.of_efficiency(0.9)
    assert less.nominal.traction_efficiency == pytest.approx(0.9)
    assert 0.0 < less.nominal.friction_loss < less.nominal.motor_loss < 0.2
    for numbers, of_less in ((problem.start, less.start), (problem.high, less.high)):
        assert of_less * less.to_group == pytest.approx(numbers * problem.to_group)
    assert less.predict(short_runs, less.start) == pytest.approx(
        problem.predict(short_runs, problem.start)
    )
    none = problem.of_efficiency(1.0).nominal
    assert none.motor_loss == none.friction_loss == 0.0


@pytest.mark.parametrize("name", sorted(preset_names()))
@pytest.mark.parametrize("unit", ["W", "A"])
def test_the_fit_of_every_robot_starts_at_its_file_and_within_its_bounds(
    name: str, unit: str, short_runs: Runs
) -> None:
    robot = load_robot(name)
    problem = parameters(short_runs if unit == "W" else of_current(short_runs), robot)
    assert len(problem.start) == len(problem.groups) == (5 if unit == "W" else 4)
    assert (problem.low <= problem.start).all() and (problem.start <= problem.high).all()
    assert (problem.low < problem.high).all() and (problem.scale > 0.0).all()
    again = problem.robot(problem.start)
    assert again.mass_kg == robot.mass_kg and again.drag_ns2_per_m2 == robot.drag_ns2_per_m2
    assert again.rolling_resistance == pytest.approx(robot.rolling_resistance)
    assert ancillary_power(again, 7.0) == pytest.approx(ancillary_power(robot, 7.0))


def test_the_robot_of_a_theta_has_its_numbers(husky: Robot, short_runs: Runs) -> None:
    robot = parameters(short_runs, husky).robot(np.array([70.0, 0.4, 6.0, 0.5, 40.0]))
    assert (robot.mass_kg, robot.drag_ns2_per_m2) == (40.0, 0.5)
    assert robot.rolling_resistance == pytest.approx(0.15)
    assert ancillary_power(robot, 10.0) == pytest.approx(70.0 + 0.4 * 10.0)


def test_another_idle_power_is_shared_out_as_before(husky: Robot) -> None:
    parts = ("sensing_idle_w", "communication_w", "controller_w")
    double = with_ancillary(husky, 120.0, 1.4)
    assert [getattr(double, one) for one in parts] == pytest.approx(
        [2.0 * getattr(husky, one) for one in parts]
    )
    assert double.computer_j_per_sample == pytest.approx(1.4)
    assert with_ancillary(husky, 60.0, 0.7) is husky
    none = dataclasses.replace(husky, sensing_idle_w=0.0, communication_w=0.0, controller_w=0.0)
    assert with_ancillary(none, 30.0, 0.7).controller_w == 30.0


def test_an_effect_brings_its_track_to_a_robot_without_one(husky: Robot) -> None:
    turning = {"turning": {"scrub": 0.3, "track_m": 0.8}}
    found = with_effects_of(
        dataclasses.replace(husky, effects={"standby": {"power_w": 5.0}}), turning
    )
    assert found.track_m == 0.8
    assert found.effects == {"standby": {"power_w": 5.0}, "turning": {"scrub": 0.3}}
    assert with_effects_of(husky, {"turning": {"scrub": 0.3}}).track_m == husky.track_m


def test_predictions_are_those_of_the_robot_with_its_effects(
    husky: Robot, short_runs: Runs
) -> None:
    problem = parameters(short_runs, husky)
    np.testing.assert_allclose(
        problem.predict(short_runs, problem.start), predict(short_runs, husky)
    )
    turning = {"turning": {"scrub": 0.3}}
    np.testing.assert_allclose(
        problem.predict(short_runs, problem.start, WithEffects(turning)),
        predict(short_runs, dataclasses.replace(husky, effects=turning)),
    )


def test_derivatives_are_those_of_the_force_balance(husky: Robot, short_runs: Runs) -> None:
    """By hand where the robot drives on the level: P = P_idle + e f + (C_rr m g + c v^2) v /
    Gamma."""
    level = [dataclasses.replace(run, grade_rad=0.0 * run.grade_rad, accel_mps2=0.0 * run.grade_rad) for run in
             short_runs.signals]  # fmt: skip
    runs = dataclasses.replace(short_runs, signals=level)
    problem = parameters(runs, husky)
    predicted = problem.predict(runs, problem.start)
    found = derivatives(
        problem, problem.start, predicted, lambda theta: problem.predict(runs, theta)
    )
    per_unit = [column / scale for column, scale in zip(found, problem.scale, strict=True)]
    powers = [np.concatenate([
        cut.means(np.maximum(run.speed_mps, 0.0) ** power) for run, cut in zip(level, runs.windows, strict=True)
    ]) for power in (1, 3)]  # fmt: skip
    gamma = husky.traction_efficiency
    np.testing.assert_allclose(per_unit[AT_REST], 1.0, rtol=1e-6)
    np.testing.assert_allclose(per_unit[1], runs.sensing_hz, atol=1e-5)
    np.testing.assert_allclose(per_unit[ROLLING], 9.81 * powers[0] / gamma, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(per_unit[DRAG], powers[1] / gamma, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(per_unit[MASS], 0.0, atol=1e-3)


def test_derivatives_at_a_bound_step_inside(husky: Robot, short_runs: Runs) -> None:
    problem = parameters(short_runs, husky)
    theta, tried = problem.high.copy(), []

    def predict_within(moved: np.ndarray) -> np.ndarray:
        tried.append(moved)
        return problem.predict(short_runs, moved)

    found = derivatives(problem, theta, problem.predict(short_runs, theta), predict_within)
    assert all((moved <= problem.high).all() for moved in tried)
    np.testing.assert_allclose(found[AT_REST], problem.scale[AT_REST], rtol=1e-6)


@pytest.mark.parametrize("motor_loss", [0.047, 0.3])
def test_a_group_is_known_whatever_losses_the_file_assumes(
    motor_loss: float, husky: Robot, short_runs: Runs
) -> None:
    """Only mass over efficiency is determined, and neither of the two."""
    runs = dataclasses.replace(short_runs, observed=predict(short_runs, husky))
    fit = refit(runs, dataclasses.replace(husky, motor_loss=motor_loss))
    known = {one.group.symbol: one.fitted for one in estimates(fit, runs, cut_blocks(runs.run))}
    assert known["m / Gamma"] == pytest.approx(husky.mass_kg / husky.traction_efficiency, rel=1e-3)
    assert (fit.theta[MASS] == pytest.approx(husky.mass_kg, rel=1e-3)) == (
        motor_loss == husky.motor_loss
    )


def test_groups_of_current_do_not_depend_on_a_thrust_that_no_file_gives(
    husky: Robot, short_runs: Runs
) -> None:
    unknown = dataclasses.replace(husky, traction_n_per_a=0.0)
    given = of_current(short_runs)
    runs = dataclasses.replace(
        given, observed=predict(given, dataclasses.replace(husky, rest_current_a=0.5))
    )
    found = {}
    for robot in (husky, unknown):
        fit = refit(runs, robot)
        assert fit.parameters.current_known == (robot is husky)
        known = estimates(fit, runs, cut_blocks(runs.run))
        assert (known[ROLLING].assumed is None) == (robot is unknown)
        found[robot.traction_n_per_a] = [one.fitted for one in known]
    (first, second) = found.values()
    assert first[0] == pytest.approx(0.5, rel=1e-3)
    assert first[ROLLING] == pytest.approx(second[ROLLING], rel=1e-3)
    assert first[MASS] == pytest.approx(second[MASS], rel=1e-3)
