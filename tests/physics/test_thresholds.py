"""Thresholds of the physics: those that are derived are what is derived."""

import dataclasses

import pytest

from homeward.physics import Robot, d_max, load_robot, preset_names, thresholds


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    # m that a charge lifts the robot
    assert pytest.approx(25.0, rel=0.03) == thresholds.LEAST_J_PER_KG / 9.80665
    parts = ("sensing_idle_w", "communication_w", "controller_w", "computer_w")
    most_w = max(sum(getattr(load_robot(name), part) for part in parts) for name in preset_names())
    assert thresholds.MOST_ANCILLARY_W / most_w == pytest.approx(300.0, rel=0.2)


def test_plausible_values_are_of_parameters_of_a_robot() -> None:
    assert {*thresholds.PLAUSIBLE} <= {field.name for field in dataclasses.fields(Robot)}
    assert all(low < high for low, high, _ in thresholds.PLAUSIBLE.values())


def test_every_preset_runs_empty_within_the_longest_memory() -> None:
    for name in preset_names():
        robot = load_robot(name)
        assert float(d_max(robot)) / robot.max_speed_mps < thresholds.LONGEST_MEMORY_S
