"""The rover in MuJoCo: what contact costs agrees with what its parts must cost."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.concealed.plants.motion import Array
from benchmarks.concealed.plants.rover_drives import Leg, command, cruise
from benchmarks.concealed.plants.rover_engine import (
    WHEEL_RADIUS_M,
    Ground,
    Log,
    Rover,
    Trip,
    World,
    drive,
)

GROUND = Ground(sliding=0.75, rolling=0.06)
LEVEL = World(GROUND)
ROVER = Rover(mass_kg=50.0, efficiency=0.7, idle_w=50.0)
WEIGHT_N = 50.0 * 9.80665
WHEEL_INERTIA_KG = 4.0 * (0.15 / WHEEL_RADIUS_M**2 + 0.4 * 2.5)  # at the rim: rotors and spheres


def go(
    asked: tuple[Array, Array],
    world: World = LEVEL,
    machine: Rover = ROVER,
    payload_kg: float = 0.0,
) -> Log:
    speed, yaw = asked
    return drive(machine, Trip(speed, yaw, np.full(speed.size, payload_kg), world))


def drive_w(log: Log) -> float:
    return float(np.mean(log.power_w - ROVER.idle_w))


@pytest.mark.parametrize(("speed_mps", "payload_kg"), [(0.2, 0.0), (0.95, 20.0)])
def test_cruising_costs_rolling_resistance(speed_mps: float, payload_kg: float) -> None:
    log = go(cruise([speed_mps], 4.0), payload_kg=payload_kg)
    weight_n = WEIGHT_N + 9.80665 * payload_kg
    assert drive_w(log) == pytest.approx(
        GROUND.rolling * weight_n * log.speed_mps.mean() / ROVER.efficiency, rel=0.02
    )


def test_climbing_costs_weight_and_descending_gives_back_what_recovery_says() -> None:
    up, down = (
        go(cruise([0.5], 4.0), World(GROUND, slope=((0.0, slope),))) for slope in (0.1, -0.1)
    )
    force_n = WEIGHT_N * (np.sin(0.1) + GROUND.rolling * np.cos(0.1))
    assert drive_w(up) == pytest.approx(
        force_n * up.wheel_left_mps.mean() / ROVER.efficiency, rel=0.02
    )
    assert drive_w(down) == 0.0
    back = go(
        cruise([0.5], 4.0),
        World(GROUND, slope=((0.0, -0.1),)),
        Rover(50.0, 0.7, 50.0, recovery=0.5),
    )
    braking_n = WEIGHT_N * (np.sin(0.1) - GROUND.rolling * np.cos(0.1))
    assert drive_w(back) == pytest.approx(
        -0.5 * 0.7 * braking_n * back.wheel_left_mps.mean(), rel=0.03
    )


def test_turning_costs_clearly_more_than_rolling_and_more_where_it_is_rough() -> None:
    spot = command([Leg(6.0, 0.0, 0.4)], 6.0, 0.1)
    straight_w, bend_w, spot_w = (
        drive_w(go(asked))
        for asked in (cruise([0.5], 6.0), command([Leg(6.0, 0.5, 0.2)], 6.0, 0.1), spot)
    )
    assert bend_w > 2.0 * straight_w and spot_w > 2.0 * straight_w
    assert drive_w(go(spot, World(Ground(0.4, 0.06)))) < 0.7 * spot_w


def test_speeding_up_costs_the_kinetic_energy_of_body_wheels_and_rotors() -> None:
    log = go(command([Leg(2.0, 0.2), Leg(6.0, 0.9)], 8.0, 0.8))
    rolling_n = GROUND.rolling * WEIGHT_N
    spent_j = (
        np.sum((log.power_w - ROVER.idle_w) * ROVER.efficiency - rolling_n * log.speed_mps) * 0.1
    )
    gained_j = 0.5 * (50.0 + WHEEL_INERTIA_KG) * (log.speed_mps[-1] ** 2 - log.speed_mps[0] ** 2)
    assert spent_j == pytest.approx(gained_j, rel=0.05)


def test_wheels_slip_more_on_steep_and_loose_ground() -> None:
    def slip(sliding: float, slope: float) -> float:
        log = go(cruise([0.5], 4.0), World(Ground(sliding, 0.06), slope=((0.0, slope),)))
        return float(1.0 - log.speed_mps.mean() / log.wheel_left_mps.mean())

    assert slip(0.3, 0.15) > 0.1 > 0.05 > slip(0.8, 0.15) > slip(0.8, 0.0) >= 0.0


def test_every_wheel_feels_the_ground_that_is_under_it() -> None:
    log = go(cruise([0.5], 8.0), World(GROUND, ((2.0, 99.0, Ground(0.75, 0.12)),)))
    on_hard, between_axles, on_soft = (
        log.place_m < 1.7,
        np.abs(log.place_m - 2.0) < 0.1,
        log.place_m > 2.3,
    )
    hard_w, both_w, soft_w = (
        float(np.mean(log.power_w[at])) - ROVER.idle_w for at in (on_hard, between_axles, on_soft)
    )
    assert soft_w == pytest.approx(2.0 * hard_w, rel=0.05)
    assert both_w == pytest.approx(1.5 * hard_w, rel=0.05)  # one axle after the other
