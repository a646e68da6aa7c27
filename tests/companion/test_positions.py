"""Noise of positions does not lengthen the trail, and wrong dead reckoning does not lead away from
them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from homeward.companion.positions import PositionFilter
from homeward.companion.readings import Reading
from homeward.companion.way import Way

STEP_M, STEPS = 1.0, 600


def follow(
    noise_m: float, *, heading_off_rad: float = 0.0, gain: float = 1.0
) -> tuple[float, float]:
    """Drive in a wide bend; returns the length of the filtered trail over the true one, and the
    last error, m."""
    rng = np.random.default_rng(1)
    place = np.zeros(2)
    positions, trail = PositionFilter(np.zeros(2)), [np.zeros(2)]
    positions.see(place + noise_m * rng.standard_normal(2), reckons=False)
    for step in range(STEPS):
        heading = 2.0 * step / STEPS
        place = place + STEP_M * np.array([math.cos(heading), math.sin(heading)])
        read = heading + heading_off_rad
        positions.reckon(gain * STEP_M * np.array([math.cos(read), math.sin(read)]))
        positions.see(place + noise_m * rng.standard_normal(2), reckons=True)
        trail.append(positions.place)
    filtered_m = float(np.hypot(*np.diff(np.array(trail[50:]), axis=0).T).sum())
    return filtered_m / (STEP_M * (STEPS + 1 - 50)), float(np.hypot(*(positions.place - place)))


@pytest.mark.parametrize("noise_m", [0.0, 1.0, 10.0])
def test_the_trail_is_as_long_as_the_way(noise_m: float) -> None:
    length, error_m = follow(noise_m)
    assert length == pytest.approx(1.0, abs=0.05)
    assert error_m <= 0.5 * noise_m


@pytest.mark.parametrize(
    ("heading_off_rad", "gain"), [(math.pi, 1.0), (0.5, 1.0), (0.0, 0.0), (0.0, 2.0)]
)
def test_wrong_dead_reckoning_is_found_out(heading_off_rad: float, gain: float) -> None:
    """A compass that is off, wheels that slip or do not turn: positions within a metre are
    followed."""
    length, error_m = follow(1.0, heading_off_rad=heading_off_rad, gain=gain)
    assert error_m < 3.0
    assert length < 1.8


def test_a_jump_of_the_positions_is_followed() -> None:
    positions = PositionFilter(np.zeros(2))
    for step in range(100):
        positions.reckon(np.array([1.0, 0.0]))
        positions.see(np.array([float(step + 1), 50.0 if step > 80 else 0.0]), reckons=step > 0)
    assert positions.place == pytest.approx([100.0, 50.0], abs=1.0)


def ways_home_m(home: tuple[float, float] | str, noise_m: float, seed: int) -> tuple[float, float]:
    """Way home of a slow robot that drove 100 m out, its heading unread for a while, and its
    standard deviation."""
    rng = np.random.default_rng(seed)
    way = Way(home, None, crumb_m=1.0, most_m=1e4)
    for step in range(501):
        east, north = 0.2 * step + noise_m * rng.standard_normal(), noise_m * rng.standard_normal()
        heading = math.nan if 200 < step < 230 else 0.0
        way.follow(
            Reading(
                1.0,
                0.2,
                math.nan,
                math.nan,
                math.nan,
                heading,
                math.nan,
                math.nan,
                0.0,
                math.nan,
                math.nan,
                (east, north),
            )
        )
    return way.position_m, way.unsure_m


@pytest.mark.parametrize("home", [(0.0, 0.0), "here"])
def test_the_way_home_is_not_longer_by_the_first_positions_or_by_those_without_a_heading(
    home: tuple[float, float] | str,
) -> None:
    assert ways_home_m(home, 0.0, 0)[0] == pytest.approx(100.0, abs=0.5)
    errors_m, unsure_m = zip(*[ways_home_m(home, 10.0, seed) for seed in range(8)], strict=True)
    assert np.abs(np.array(errors_m) - 100.0).max() < 15.0
    assert np.abs(np.array(errors_m) - 100.0).mean() < 8.0
    assert 0.2 < np.mean(unsure_m) < 10.0
