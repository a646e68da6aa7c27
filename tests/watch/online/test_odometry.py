"""Positions in one frame, whatever becomes of the process that publishes them."""

import math

import pytest

from homeward.companion.saved import put_values, values_of
from homeward.watch.online.odometry import Odometry


def test_poses_are_as_published() -> None:
    odometry = Odometry(1.0)
    assert odometry.place((5.0, 1.0, 0.3), 0.5, 1, 0.0) == ((5.0, 1.0, 0.3), False)
    assert odometry.place((6.0, 1.0, 0.3), 0.5, 1, 1.0) == ((6.0, 1.0, 0.3), False)


def test_one_that_is_restarted_goes_on_where_the_robot_was() -> None:
    """North at (40, 30) when it stopped, 10 s at 0.5 m/s ago; it begins at zero, looking along its
    own x."""
    odometry = Odometry(1.0)
    odometry.place((40.0, 30.0, 0.5 * math.pi), 0.5, 1, 0.0)
    place, moved = odometry.place((0.0, 0.0, 0.0), 0.5, 2, 10.0)
    assert moved and place == pytest.approx((40.0, 35.0, 0.5 * math.pi))
    place, moved = odometry.place((2.0, -1.0, 0.1), 0.5, 2, 12.0)
    assert not moved and place == pytest.approx((41.0, 37.0, 0.5 * math.pi + 0.1))
    other = Odometry(1.0)
    put_values(other, values_of(odometry))
    assert other.place((2.0, -1.0, 0.1), 0.5, 2, 0.0)[0] == pytest.approx(place)


def test_a_publisher_that_kept_its_pose_is_believed() -> None:
    odometry = Odometry(1.0)
    odometry.place((40.0, 30.0, 0.0), 1.0, 1, 0.0)
    assert odometry.place((48.0, 30.0, 0.0), 1.0, 2, 8.0) == ((48.0, 30.0, 0.0), False)


def test_a_jump_of_the_same_publisher_is_left_to_the_companion() -> None:
    odometry = Odometry(1.0)
    odometry.place((40.0, 30.0, 0.0), 1.0, 1, 0.0)
    assert odometry.place((0.0, 0.0, 0.0), 1.0, 1, 0.1) == ((0.0, 0.0, 0.0), False)
