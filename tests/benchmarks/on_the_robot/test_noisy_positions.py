"""The way home of a drive is that of its motion, and noise is what makes it differ."""

import numpy as np
import pytest

from benchmarks.on_the_robot.noisy_positions import Motion, ways_home_m


def test_the_way_home_is_that_of_the_motion_and_near_it_with_noise() -> None:
    time_s = np.arange(1.0, 121.0)
    place_m = np.column_stack([0.8 * time_s, 0.0 * time_s])
    motion = Motion(time_s, np.full(120, 0.8), np.zeros(120), place_m)
    exact_m = ways_home_m(motion, 0.0, False, np.random.default_rng(0))
    noisy_m = ways_home_m(motion, 5.0, True, np.random.default_rng(0))
    assert exact_m == pytest.approx(place_m[:, 0], abs=0.01)
    assert 0.01 < abs(noisy_m[-1] - exact_m[-1]) < 8.0
