"""Noise of positions does not lengthen the trail, and wrong dead reckoning does not lead away from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from homeward.companion.positions import PositionFilter

STEP_M, STEPS = 1.0, 600


def follow(noise_m: float, *, heading_off_rad: float = 0.0, gain: float = 1.0) -> tuple[float, float]:
    """Drive in a wide bend; returns the length of the filtered trail over the true one, and the last error, m."""
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


@pytest.mark.parametrize(("heading_off_rad", "gain"), [(math.pi, 1.0), (0.5, 1.0), (0.0, 0.0), (0.0, 2.0)])
def test_wrong_dead_reckoning_is_found_out(heading_off_rad: float, gain: float) -> None:
    """A compass that is off, wheels that slip or do not turn: positions within a metre are followed."""
    length, error_m = follow(1.0, heading_off_rad=heading_off_rad, gain=gain)
    assert error_m < 3.0
    assert length < 1.8


def test_a_jump_of_the_positions_is_followed() -> None:
    positions = PositionFilter(np.zeros(2))
    for step in range(100):
        positions.reckon(np.array([1.0, 0.0]))
        positions.see(np.array([float(step + 1), 50.0 if step > 80 else 0.0]), reckons=step > 0)
    assert positions.place == pytest.approx([100.0, 50.0], abs=1.0)
