"""Commands of the rover: within limits, as long as asked, and of the motion that they are named
for."""

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.concealed.plants.rover_drives import (
    TICKS_PER_S,
    YAW_RADPS2,
    Command,
    Leg,
    command,
    cruise,
    on_the_spot,
    stop_and_go,
    tour,
)

DRAWN: dict[str, Callable[[np.random.Generator], Command]] = {
    "stop and go": lambda rng: stop_and_go(rng, 60.0),
    "tour": lambda rng: tour(rng, 60.0, 0.6),
    "on the spot": lambda rng: on_the_spot(rng, 60.0),
}
SEEDS = range(5)


@pytest.mark.parametrize("kind", DRAWN)
def test_a_drive_is_as_long_as_asked_and_changes_no_faster_than_a_rover_can(kind: str) -> None:
    for seed in SEEDS:
        speed, yaw = DRAWN[kind](np.random.default_rng(seed))
        assert speed.size == yaw.size == 60 * TICKS_PER_S
        assert np.abs(np.diff(speed)).max() <= 1.2 / TICKS_PER_S + 1e-12
        assert np.abs(np.diff(yaw)).max() <= YAW_RADPS2 / TICKS_PER_S + 1e-12
        assert speed.min() >= 0.0 and speed.max() <= 1.0


def test_a_ramp_has_the_acceleration_that_is_asked_for() -> None:
    speed, _ = command([Leg(2.0, 0.2), Leg(4.0, 0.8)], 6.0, 0.3)
    assert (speed[: 2 * TICKS_PER_S] == 0.2).all()
    assert np.flatnonzero(speed >= 0.8 - 1e-9)[0] - 2 * TICKS_PER_S == pytest.approx(
        2.0 * TICKS_PER_S, abs=1
    )


def test_the_last_leg_holds_its_speed_to_the_end_straight_on() -> None:
    speed, yaw = command([Leg(1.0, 0.5, 0.1)], 10.0, 1.0)
    assert (speed == 0.5).all() and yaw[-1] == 0.0 and yaw[0] == pytest.approx(0.1)


def test_a_slalom_turns_as_much_to_the_left_as_to_the_right() -> None:
    _, yaw = command([Leg(20.0, 0.5, 0.2, weave_s=10.0)], 20.0, 1.0)
    assert (
        yaw[0] == 0.0
        and yaw.sum() / TICKS_PER_S == pytest.approx(0.0, abs=0.01)
        and yaw.max() == pytest.approx(0.2, abs=0.01)
    )


def test_a_cruise_goes_straight_on_and_hardly_accelerates() -> None:
    speed, yaw = cruise([0.3, 0.32], 60.0)
    assert (yaw == 0.0).all() and np.abs(np.diff(speed)).max() * TICKS_PER_S <= 0.001 + 1e-9
    assert speed[0] == 0.3 and speed[-1] == pytest.approx(0.32)


def test_drives_are_of_the_motion_that_they_are_named_for() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        going, straight = stop_and_go(rng, 60.0)
        assert (straight == 0.0).all() and going.min() == 0.0 and going.max() > 0.5
        touring, bends = tour(rng, 60.0, 0.6)
        assert (touring == 0.6).all() and np.abs(bends).max() > 0.09 and (bends == 0.0).any()
        standing, turns = on_the_spot(rng, 60.0)
        assert (standing == 0.0).all() and np.abs(turns).max() > 0.15 and (turns == 0.0).any()
