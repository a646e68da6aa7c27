"""Vehicles and the powers that concealed physics is scaled by."""

from __future__ import annotations

import dataclasses

import pytest

from benchmarks.concealed.plants.vehicles import (
    JACKAL,
    VEHICLES,
    Plant,
    idle_power_w,
    peak_power_w,
    rolling_power_w,
    typical_power_w,
)

each = pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.robot.name)


def test_the_powers_of_one_vehicle_worked_out_by_hand() -> None:
    """Jackal: 17 kg, C_rr 0.08, 2 m/s; 67.5 % of what motors take reaches the ground."""
    assert rolling_power_w(JACKAL) == pytest.approx(
        17.0 * 9.80665 * 0.08 * 1.2 / (0.9 * 0.75), rel=1e-9
    )
    assert idle_power_w(JACKAL) == 5.0 + 1.5 + 12.0
    assert typical_power_w(JACKAL) == pytest.approx(rolling_power_w(JACKAL) + 18.5 + 0.15 * 25.0)
    force_n = (0.08 + 0.12) * 17.0 * 9.80665 + 0.08 * 4.0
    assert peak_power_w(JACKAL) == pytest.approx(force_n * 2.0 / (0.9 * 0.75) + 18.5 + 0.15 * 50.0)


@each
def test_powers_rank_and_rolling_is_linear_in_mass(vehicle: Plant) -> None:
    assert 0.0 < rolling_power_w(vehicle) < typical_power_w(vehicle) < peak_power_w(vehicle)
    heavier = dataclasses.replace(vehicle.robot, mass_kg=2.0 * vehicle.robot.mass_kg)
    twice = rolling_power_w(dataclasses.replace(vehicle, robot=heavier))
    assert twice == pytest.approx(2.0 * rolling_power_w(vehicle))


@each
def test_a_vehicle_is_one_that_can_be(vehicle: Plant) -> None:
    robot = vehicle.robot
    assert 0.0 < vehicle.steepest_grade_rad < 0.7
    assert (
        vehicle.wheelbase_m > 0.0
        and robot.track_m > 0.0
        and vehicle.leg_m > 10.0 * vehicle.wheelbase_m
    )
    # a battery lasts hours
    assert 3600.0 < robot.usable_energy_j / typical_power_w(vehicle) < 86400.0
    assert vehicle.source


def test_vehicles_are_of_all_sizes_and_kinds_of_steering() -> None:
    masses = [vehicle.robot.mass_kg for vehicle in VEHICLES]
    assert masses == sorted(masses) and masses[-1] > 1000.0 * masses[0]
    assert {vehicle.steering for vehicle in VEHICLES} == {"skid", "differential", "ackermann"}
