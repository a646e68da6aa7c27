from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.plants import rover
from benchmarks.plants import rover_scenarios as hidden
from benchmarks.plants.case import Array, Case, write
from benchmarks.plants.rover_drives import Leg, command, cruise, tour
from benchmarks.plants.rover_engine import WHEEL_RADIUS_M, Ground, Log, Rover, Trip, World, drive
from homeward.diagnosis.recordings import read_recording
from homeward.physics import EFFECTS

GROUND = Ground(sliding=0.75, rolling=0.06)
LEVEL = World(GROUND)
ROVER = Rover(mass_kg=50.0, efficiency=0.7, idle_w=50.0)
WEIGHT_N = 50.0 * 9.80665
WHEEL_INERTIA_KG = 4.0 * (0.15 / WHEEL_RADIUS_M**2 + 0.4 * 2.5)  # at the rim: rotors and spheres

built = cache(rover.simulate)


def go(asked: tuple[Array, Array], world: World = LEVEL, machine: Rover = ROVER, payload_kg: float = 0.0,
       start_m: float = 0.0, heading_rad: float = 0.0) -> Log:  # fmt: skip
    speed, yaw = asked
    return drive(machine, Trip(speed, yaw, np.full(speed.size, payload_kg), world, start_m, heading_rad))


def drive_w(log: Log) -> float:
    return float(np.mean(log.power_w - log.idle_w))


@pytest.mark.parametrize("speed_mps", [0.2, 0.5, 0.95])
@pytest.mark.parametrize("payload_kg", [0.0, 20.0])
def test_cruising_costs_rolling_resistance(speed_mps: float, payload_kg: float) -> None:
    log = go(cruise([speed_mps], 4.0), payload_kg=payload_kg)
    weight_n = WEIGHT_N + 9.80665 * payload_kg
    assert drive_w(log) == pytest.approx(GROUND.rolling * weight_n * log.speed_mps.mean() / ROVER.efficiency, rel=0.02)
    assert log.speed_mps.mean() == pytest.approx(speed_mps, rel=0.06)
    assert np.abs(log.yaw_radps).max() < 1e-6


def test_climbing_costs_weight_and_descending_gives_nothing_back() -> None:
    up, down = (go(cruise([0.5], 4.0), World(GROUND, slope=((0.0, slope),))) for slope in (0.1, -0.1))
    force_n = WEIGHT_N * (np.sin(0.1) + GROUND.rolling * np.cos(0.1))
    assert drive_w(up) == pytest.approx(force_n * up.wheel_left_mps.mean() / ROVER.efficiency, rel=0.02)
    assert drive_w(down) == 0.0
    back = go(cruise([0.5], 4.0), World(GROUND, slope=((0.0, 0.1),)), heading_rad=np.pi, start_m=9.0)
    assert back.place_m[-1] < back.place_m[0] < 9.1 and back.grade_rad[-1] == pytest.approx(-0.1)


def test_recovery_gives_its_share_of_the_braking_energy_back() -> None:
    descent = World(GROUND, slope=((0.0, -0.1),))
    log = go(cruise([0.5], 4.0), descent, Rover(50.0, 0.7, 50.0, recovery=0.5))
    force_n = WEIGHT_N * (np.sin(0.1) - GROUND.rolling * np.cos(0.1))
    assert drive_w(log) == pytest.approx(-0.5 * 0.7 * force_n * log.wheel_left_mps.mean(), rel=0.03)


def test_turning_costs_clearly_more_than_rolling_and_more_where_it_is_rough() -> None:
    bend = command([Leg(6.0, 0.5, 0.2)], 6.0, 0.1)
    spot = command([Leg(6.0, 0.0, 0.4)], 6.0, 0.1)
    straight_w, bend_w, spot_w = (drive_w(go(asked)) for asked in (cruise([0.5], 6.0), bend, spot))
    assert bend_w > 2.0 * straight_w and spot_w > 2.0 * straight_w
    assert drive_w(go(spot, World(Ground(0.4, 0.06)))) < 0.7 * spot_w
    assert go(spot).heading_rad[-1] - go(spot).heading_rad[0] == pytest.approx(0.4 * 6.0, rel=0.15)


def test_speeding_up_costs_the_kinetic_energy_of_body_wheels_and_rotors() -> None:
    log = go(command([Leg(2.0, 0.2), Leg(6.0, 0.9)], 8.0, 0.8))
    rolling_n = GROUND.rolling * WEIGHT_N
    spent_j = np.sum((log.power_w - log.idle_w) * ROVER.efficiency - rolling_n * log.speed_mps) * 0.1
    gained_j = 0.5 * (50.0 + WHEEL_INERTIA_KG) * (log.speed_mps[-1] ** 2 - log.speed_mps[0] ** 2)
    assert spent_j == pytest.approx(gained_j, rel=0.05)


def test_wheels_slip_more_on_steep_and_loose_ground() -> None:
    def slip(sliding: float, slope: float) -> float:
        log = go(cruise([0.5], 4.0), World(Ground(sliding, 0.06), slope=((0.0, slope),)))
        return float(1.0 - log.speed_mps.mean() / log.wheel_left_mps.mean())

    assert slip(0.3, 0.15) > 0.1 > 0.05 > slip(0.8, 0.15) > slip(0.8, 0.0) >= 0.0


def test_every_wheel_feels_the_ground_that_is_under_it() -> None:
    soft = Ground(0.75, 0.12)
    log = go(cruise([0.5], 8.0), World(GROUND, ((2.0, 99.0, soft),)))
    assert set(np.round(log.changed[log.changed % 0.25 == 0.0], 2)) == {0.0, 0.5, 1.0}  # one axle after the other
    hard_w, soft_w = (float(np.mean((log.power_w - log.idle_w)[log.changed == share])) for share in (0.0, 1.0))
    assert soft_w == pytest.approx(2.0 * hard_w, rel=0.05)


def test_cases_are_many_enough_and_half_of_them_have_wheel_speeds() -> None:
    kinds, singles = Counter[str](), Counter[str]()
    for build, times, levels in rover.LISTED:
        scenario = build(np.random.default_rng(0))
        kinds[scenario.kind] += times * len(levels)
        if scenario.kind == "single":
            singles[scenario.truth[0]] += times * len(levels)
        if scenario.kind != "outside":
            assert {*scenario.truth} <= {effect.id for effect in EFFECTS}
    least = {"turning": 12, "inertia": 8, "slip": 6, "surface": 8, "payload": 6, "hidden_grade": 6}
    assert all(singles[effect] >= number for effect, number in least.items())
    assert kinds["pair"] >= 8 and kinds["outside"] >= 2 and kinds["exact"] >= 12


@pytest.mark.parametrize(
    "number, build",
    [(0, hidden.turning), (1, hidden.inertia), (2, hidden.slip), (3, hidden.surface), (4, hidden.payload),
     (5, hidden.hidden_grade), (9, hidden.payload_on_hills), (6, hidden.regeneration), (7, hidden.stuck_brake),
     (8, hidden.chatter)],
)  # fmt: skip
def test_what_is_missing_lies_in_the_affected_samples_and_survives_a_refit(number: int, build: hidden.Build) -> None:
    rollout = built(build, 3, number)
    runs, noise_rms = rover.record(rollout, "low", 0, rollout.robot, exact=False)
    missing = np.abs(np.concatenate([rollout.missing(log) for log in rollout.logs]))
    affected = np.concatenate([run.affected for run in runs])
    assert 0.02 < affected.mean() < 0.98
    assert missing[affected].sum() > 0.8 * missing.sum()
    assert missing[affected].mean() > 3.0 * noise_rms
    assert rollout.absorbed < 0.9


@pytest.mark.parametrize("number, build", [(0, hidden.level), (2, hidden.level), (1, hidden.hilly)])
def test_controls_lack_less_than_the_lowest_noise(number: int, build: hidden.Build) -> None:
    rollout = built(build, 3, number)
    runs, noise_rms = rover.record(rollout, "low", 0, rollout.robot, exact=True)
    missing = np.concatenate([rollout.missing(log) for log in rollout.logs])
    assert np.sqrt(np.mean(missing**2)) < 0.3 * noise_rms
    assert not any(run.affected.any() for run in runs)


def test_recordings_read_back_and_repeat_with_the_seed(tmp_path: Path) -> None:
    for number, build in ((0, hidden.level), (2, hidden.level), (1, hidden.hilly), (5, hidden.hidden_grade)):
        rollout = built(build, 3, number)
        first, again = (rover.record(rollout, "high", 7, rollout.robot, exact=False) for _ in range(2))
        other, _ = rover.record(rollout, "high", 8, rollout.robot, exact=False)
        case = Case(f"case_{number}_{build.__name__}", "rover", "exact", (), "high", 7, rollout.robot, *first)
        for path, run, same, unlike in zip(
            write(case, tmp_path / "seen", tmp_path / "truth"), first[0], again[0], other, strict=True
        ):
            read = read_recording(path)
            assert set(run.channels) - {"time_s"} <= set(read.channels)
            assert all(np.array_equal(run.channels[name], same.channels[name]) for name in run.channels)
            assert not all(np.array_equal(run.channels[name], unlike.channels[name]) for name in run.channels)


def test_the_same_seed_drives_the_same() -> None:
    first, again, other = (go(tour(np.random.default_rng(seed), 15.0, 0.6)) for seed in (5, 5, 6))
    assert np.array_equal(first.power_w, again.power_w) and not np.array_equal(first.power_w, other.power_w)
