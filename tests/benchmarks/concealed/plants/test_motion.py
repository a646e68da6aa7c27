"""Motion: routes with the steepest slope that is asked for, and channels that belong to one
another."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from benchmarks.concealed.plants.motion import Course, Motion, make_drives, make_route
from benchmarks.concealed.plants.vehicles import JACKAL, RACER, SCOUT, VEHICLES, Plant


def routes(vehicle: Plant = SCOUT, count: int = 20) -> list[Course]:
    rng = np.random.default_rng(0)
    return [make_route(vehicle, rng) for _ in range(count)]


def driven(
    vehicle: Plant = SCOUT, loop: bool = False, seed: int = 1, short: bool = False
) -> Motion:
    rng = np.random.default_rng(seed)
    route = next(one for one in iter(lambda: make_route(vehicle, rng), None) if one.loop == loop)
    return make_drives(vehicle, [route], rng, 1, 15.0, short)[0]


def test_hills_are_as_steep_as_the_ground_allows_and_end_as_high_as_they_begin() -> None:
    for route in routes():
        slopes = np.abs(route.elevation(np.linspace(0.0, route.length_m, 2000), 1))
        assert 0.49 * SCOUT.steepest_grade_rad < slopes.max() < 1.01 * SCOUT.steepest_grade_rad
        assert route.elevation(0.0) == pytest.approx(
            float(route.elevation(route.length_m)), abs=1e-9
        )


def test_a_loop_turns_once_and_a_way_out_turns_nowhere_on_the_whole() -> None:
    found = routes()
    for route in found:
        turned = float(route.curvature_per_m.integrate(0.0, route.length_m))
        assert turned == pytest.approx(2.0 * np.pi if route.loop else 0.0, abs=0.6)
    assert {route.loop for route in found} == {False, True}


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.robot.name)
def test_a_drive_keeps_the_limits_of_its_vehicle(vehicle: Plant) -> None:
    run = driven(vehicle)
    assert run.speed_mps[0] == run.speed_mps[-1] == 0.0
    assert run.speed_mps.min() >= 0.0 and run.speed_mps.max() <= vehicle.robot.max_speed_mps
    assert np.abs(np.diff(run.speed_mps)).max() <= vehicle.max_accel_mps2 * run.dt_s * (1.0 + 1e-9)
    assert np.abs(run.yaw_rate_radps).max() <= vehicle.max_turn_radps
    assert np.abs(run.grade_rad).max() <= 1.02 * vehicle.steepest_grade_rad
    assert (
        {0.0}
        < set(np.unique(run.sensing_hz / vehicle.robot.max_sensing_hz))
        <= {0.0, 0.2, 0.5, 1.0}
    )


@pytest.mark.parametrize("loop", [False, True])
def test_distance_is_the_integral_of_speed_and_heading_that_of_the_yaw_rate(loop: bool) -> None:
    run = driven(loop=loop)
    assert run.distance_m[-1] == pytest.approx(np.trapezoid(run.speed_mps, run.time_s), rel=1e-9)
    turned = np.unwrap(run.heading_rad)
    np.testing.assert_allclose(np.diff(turned), run.yaw_rate_radps[1:] * run.dt_s, atol=1e-9)
    assert ((run.heading_rad >= 0.0) & (run.heading_rad < 2.0 * np.pi)).all()


def test_slope_is_the_derivative_of_height_in_the_direction_of_travel() -> None:
    run = driven()
    moved = np.diff(run.distance_m) > 1e-3
    climbed = np.diff(run.elevation_m)[moved] / np.diff(run.distance_m)[moved]
    same_way = (np.diff(run.direction) == 0.0)[moved]
    middle = 0.5 * (np.sin(run.grade_rad[1:]) + np.sin(run.grade_rad[:-1]))[moved]
    np.testing.assert_allclose(climbed[same_way], middle[same_way], atol=5e-3)


def test_the_way_home_passes_the_places_of_the_way_out() -> None:
    run = next(
        run for run in (driven(seed=seed) for seed in range(20)) if (run.direction < 0.0).any()
    )
    assert set(np.unique(run.direction)) == {-1.0, 1.0}
    moving = run.speed_mps[1:] > 0.0
    same_way = run.direction[1:] == run.direction[:-1]
    steps = np.diff(run.place_m)[moving & same_way] * run.direction[1:][moving & same_way]
    assert (steps >= 0.0).all()


def test_only_what_turns_on_the_spot_looks_around_while_it_stands() -> None:
    def turns(vehicle: Plant) -> bool:
        runs = [driven(vehicle, seed=seed) for seed in range(4)]
        return any(
            ((run.speed_mps == 0.0) & (np.abs(run.yaw_rate_radps) > 0.3)).any() for run in runs
        )

    assert turns(JACKAL)
    # A car turns at the ends of its way only, where it may have stopped.
    car = driven(RACER, loop=True)
    assert (car.yaw_rate_radps[car.speed_mps == 0.0] == 0.0).all()


def test_it_is_coldest_at_six_and_the_swing_is_that_of_where_it_drives() -> None:
    rng = np.random.default_rng(0)
    for vehicle, swing_c in ((SCOUT, 8.0), (VEHICLES[0], 1.5)):
        run = make_drives(vehicle, [make_route(vehicle, rng)], rng, 1, 15.0)[0]
        # 6 h is a quarter of the day: the mean of the coldest and the warmest hour.
        assert run.temperature_c[0] == pytest.approx(15.0 - swing_c * np.cos(0.5 * np.pi), abs=1e-9)
        assert (np.diff(run.temperature_c) > 0.0).all()  # the morning warms


def test_drives_take_the_routes_in_turn_and_follow_one_another() -> None:
    rng = np.random.default_rng(0)
    found = [make_route(SCOUT, rng) for _ in range(2)]
    runs = make_drives(SCOUT, found, rng, 4, 15.0, short=True)
    assert [run.index for run in runs] == [0, 1, 2, 3]
    assert [run.elevation_m[0] for run in runs] == [
        float(found[k % 2].elevation(0.0)) for k in range(4)
    ]
    for run, after in itertools.pairwise(runs):
        assert after.day_s >= run.day_s + run.time_s[-1] + 600.0 - run.dt_s
    assert {round(1.0 / run.dt_s) for run in runs} <= {5, 10, 20}


def test_the_straight_line_to_the_start_is_no_longer_than_the_way() -> None:
    for loop in (False, True):
        run = driven(loop=loop)
        assert (run.base_distance_m <= run.distance_m + 1e-6 + 0.02 * run.distance_m[-1]).all()
        assert run.base_distance_m[0] == pytest.approx(0.0, abs=1e-9)


def test_a_loop_ends_where_it_begins() -> None:
    """Nowhere does the distance from its start change by more than the way driven."""
    rng = np.random.default_rng(0)
    route = next(route for route in iter(lambda: make_route(SCOUT, rng), None) if route.loop)
    (run,) = make_drives(SCOUT, [route], rng, 1, 20.0)
    assert run.distance_m[-1] > 1.5 * route.length_m
    step_m = np.abs(np.diff(run.base_distance_m))
    assert (step_m <= 1.5 * np.diff(run.distance_m) + 1e-9).all()
    begins = np.flatnonzero(np.diff(run.place_m) < 0.0)
    assert run.base_distance_m[begins].max() < 0.02 * route.length_m
