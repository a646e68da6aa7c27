"""Scenarios of the rover: each hides what it says, and the rest is as in a control."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.concealed.plants import rover
from benchmarks.concealed.plants import rover_scenarios as hidden
from benchmarks.concealed.plants.rover_engine import Trip

BUILDS = list(dict.fromkeys(build for build, _ in rover.KINDS))


def at(trip: Trip, place_m: float) -> float:
    """Slope at a place, rad."""
    return float(np.interp(place_m, *np.array(trip.world.slope).T))


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.__name__)
def test_a_scenario_is_one_that_a_rover_can_drive(build: hidden.Build) -> None:
    for seed in range(3):
        scenario = build(np.random.default_rng(seed))
        assert len(scenario.trips) >= 3
        for trip in scenario.trips:
            assert trip.speed_mps.shape == trip.yaw_radps.shape == trip.payload_kg.shape
            assert trip.speed_mps.min() >= 0.0 and trip.speed_mps.max() <= 1.0
            assert trip.payload_kg.min() >= 0.0 and trip.payload_kg.max() <= 30.0
        assert 0.0 < scenario.rover.efficiency < 1.0 and 0.0 <= scenario.rover.recovery < 1.0
        assert build(np.random.default_rng(seed)).trips[0].speed_mps == pytest.approx(
            scenario.trips[0].speed_mps
        )


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.__name__)
def test_what_is_there_is_what_is_said_to_be_hidden(build: hidden.Build) -> None:
    """Bends, loads, soft ground and slopes; starts and stops are of inertia, and braking of
    regeneration."""
    scenario = build(np.random.default_rng(1))
    trips, truth = scenario.trips, set(scenario.truth)
    catalogue = truth - {"stuck_brake", "chatter"}
    if not catalogue < truth:  # mechanisms outside the catalogue need bends of their own
        assert ("turning" in truth) == any(np.abs(trip.yaw_radps).max() > 0.05 for trip in trips)
    assert ("payload" in truth) == any(trip.payload_kg.any() for trip in trips)
    assert ("surface" in truth) == any(trip.world.patches for trip in trips)
    assert ("regeneration" in truth) == (scenario.rover.recovery > 0.0)
    assert (scenario.brake is not None) == (not catalogue and bool(truth))
    sloped = any(slope != 0.0 for trip in trips for _, slope in trip.world.slope)
    assert ("hidden_grade" in truth) == (sloped and not scenario.slope_known)
    fastest = max(np.abs(np.diff(trip.speed_mps)).max() for trip in trips)
    if "inertia" in truth:
        assert fastest > 0.5 / 50.0
    elif not truth:
        assert fastest < 0.001 / 50.0


def test_out_and_back_the_slope_is_met_both_ways() -> None:
    out, back = hidden.hidden_grade(np.random.default_rng(0)).trips[:2]
    assert (out.start_m, out.heading_rad) == (0.0, 0.0)
    assert (back.start_m, back.heading_rad) == (56.0, np.pi)
    assert at(out, 17.0) == pytest.approx(-at(out, 41.0)) and at(out, 17.0) > 0.02
    knots = np.array(out.world.slope)
    # it ends as high as it began
    assert np.trapezoid(knots[:, 1], knots[:, 0]) == pytest.approx(0.0)


def test_ground_of_a_patch_is_below_whoever_is_on_it() -> None:
    world = hidden.surface(np.random.default_rng(0)).trips[0].world
    (start, end, soft), _ = world.patches
    assert world.below(start) == world.below(0.5 * (start + end)) == soft
    assert world.below(end) == world.below(start - 0.01) == world.ground
    assert soft.rolling > 1.5 * world.ground.rolling


def test_a_brake_sticks_in_left_bends_and_wheels_chatter_in_a_band_of_speeds() -> None:
    stuck = hidden.stuck_brake(np.random.default_rng(0)).brake
    chatter = hidden.chatter(np.random.default_rng(0)).brake
    assert stuck is not None and chatter is not None
    speeds = np.full(4, 0.5)
    assert stuck(speeds, 0.3).max() == hidden.BRAKE_NM and not stuck(speeds, -0.3).any()
    assert chatter(speeds, 0.0).tolist() == [hidden.CHATTER_NM] * 4
    assert not chatter(np.array([0.2, 0.4, 0.6, 0.9]), 0.0).any()
