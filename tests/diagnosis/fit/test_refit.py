"""The refit recovers parameters that were planted, with intervals that are as wide as it errs."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis.fit.estimates import estimates
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING
from homeward.diagnosis.fit.refit import holding, refit
from homeward.diagnosis.fit.replay import Runs, predict
from homeward.logs.channels import Array

NAMES = ["idle_power", "sample_energy", "rolling", "drag", "mass"]


def planted(husky: Robot) -> Robot:
    """A robot that no number of its file fits."""
    return dataclasses.replace(
        husky, mass_kg=1.2 * husky.mass_kg, rolling_resistance=0.8 * husky.rolling_resistance, drag_ns2_per_m2=0.4,
        controller_w=1.5 * husky.controller_w, sensing_j_per_sample=0.3,
    )  # fmt: skip


def of(runs: Runs, robot: Robot, noise: Array | float = 0.0) -> Runs:
    """The runs as a robot would have drawn, and noise."""
    return dataclasses.replace(runs, observed=predict(runs, robot) + noise)


def groups_of(robot: Robot) -> list[float]:
    gamma = robot.traction_efficiency
    idle_w = robot.sensing_idle_w + robot.communication_w + robot.controller_w
    sample_j = robot.sensing_j_per_sample + robot.computer_j_per_sample
    per_gamma = [robot.rolling_resistance * robot.mass_kg, robot.drag_ns2_per_m2, robot.mass_kg]
    return [idle_w, sample_j, *(one / gamma for one in per_gamma)]


def test_planted_parameters_are_recovered_to_rounding(husky: Robot, short_runs: Runs) -> None:
    true = planted(husky)
    runs = of(short_runs, true)
    fit = refit(runs, husky)
    np.testing.assert_allclose(fit.predicted, runs.observed, atol=1e-3)
    np.testing.assert_allclose(fit.replayed(runs), fit.predicted)
    known = estimates(fit, runs, cut_blocks(runs.run))
    assert [one.group.name for one in known] == NAMES
    assert [one.fitted for one in known] == pytest.approx(groups_of(true), rel=1e-3)
    assert [one.assumed for one in known] == pytest.approx(groups_of(husky))
    assert all(one.off for one in known)
    assert fit.robot.mass_kg == pytest.approx(true.mass_kg, rel=1e-4)


def test_a_part_of_the_windows_is_fitted_as_if_it_were_all(husky: Robot, short_runs: Runs) -> None:
    """What the other windows hold does not matter."""
    chosen, runs = short_runs.run < 2, of(short_runs, husky)
    fit = refit(runs, husky)
    other = np.where(chosen, predict(runs, planted(husky)), 1e6)
    again = fit.fitted_to(chosen, other)
    np.testing.assert_allclose(again.predicted[chosen], other[chosen], rtol=0.01)
    np.testing.assert_allclose(
        again.theta, fit.fitted_to(chosen, np.where(chosen, other, 0.0)).theta
    )


def test_a_group_that_is_held_stays_as_the_file_says(husky: Robot, short_runs: Runs) -> None:
    runs = of(
        short_runs, dataclasses.replace(husky, rolling_resistance=1.3 * husky.rolling_resistance)
    )
    held = np.zeros(len(NAMES), dtype=bool)
    held[NAMES.index("mass")] = True
    fit = holding(refit(runs, husky), runs, held)
    assert fit.theta[MASS] == husky.mass_kg and not fit.jacobian[:, MASS].any()
    # rounding of a step does not move it
    assert fit.moved(np.ones(len(NAMES)))[MASS] == husky.mass_kg
    assert fit.theta[ROLLING] == pytest.approx(
        1.3 * husky.rolling_resistance * husky.mass_kg, rel=1e-4
    )


def test_no_fit_leaves_what_is_physical_and_one_at_a_bound_measures_nothing(
    husky: Robot, short_runs: Runs
) -> None:
    true = dataclasses.replace(
        husky, mass_kg=9.0 * husky.mass_kg, rolling_resistance=husky.rolling_resistance / 9.0
    )
    runs = of(short_runs, true)
    fit = refit(runs, husky)
    assert (fit.theta >= fit.parameters.low).all() and (fit.theta <= fit.parameters.high).all()
    assert fit.theta[MASS] == pytest.approx(fit.parameters.high[MASS]) and fit.at_bound[MASS]
    mass = estimates(fit, runs, cut_blocks(runs.run))[MASS]
    assert mass.status == "at bound" and mass.fitted is None and not mass.off


def test_a_drag_of_zero_is_no_bound(husky: Robot, short_runs: Runs) -> None:
    none = of(short_runs, dataclasses.replace(husky, drag_ns2_per_m2=0.0))
    # as a drag below zero would take
    less_w = np.maximum(short_runs.context["speed_mps"], 0.0) ** 3
    runs = dataclasses.replace(none, observed=none.observed - less_w)
    heavy = dataclasses.replace(husky, drag_ns2_per_m2=5.0)
    fit = refit(runs, heavy)
    assert fit.theta[NAMES.index("drag")] == 0.0 and not fit.at_bound.any()
