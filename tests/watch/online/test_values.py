"""Values of channels from the fields of messages."""

import math
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="needs the extra logs")

from homeward.logs.bags.topics import Topic, load_topics
from homeward.watch.online.values import (
    POSE,
    acceleration,
    east_m,
    field_value,
    heading,
    heading_of,
    slope,
)


@pytest.fixture
def imu(tmp_path: Path) -> Topic:
    path = tmp_path / "mine.toml"
    path.write_text(
        '[[topics]]\nname = "/imu"\ntype = "sensor_msgs/msg/Imu"\norientation = "orientation"\n'
        'acceleration = "linear_acceleration"\nyaw_rate_radps = { field = "angular_velocity.z", factor = -2.0 }\n'
    )
    return load_topics(path).topics[0]


def oriented(yaw_rad: float, slope_rad: float, length: float = 1.0) -> dict[str, float]:
    """Yaw about z, then pitch about the robot's y, which is negative uphill (REP 103)."""
    (s_y, c_y), (s_p, c_p) = (
        (math.sin(0.5 * one), math.cos(0.5 * one)) for one in (yaw_rad, -slope_rad)
    )
    values = (-s_y * s_p, c_y * s_p, s_y * c_p, c_y * c_p)
    return {
        f"orientation.{axis}": length * value for axis, value in zip("xyzw", values, strict=True)
    }


@pytest.mark.parametrize("yaw_rad", [-3.0, 0.0, 0.4, 2.0])
@pytest.mark.parametrize("slope_rad", [-0.3, 0.0, 0.1])
def test_slope_and_heading_are_those_of_the_orientation(
    imu: Topic, yaw_rad: float, slope_rad: float
) -> None:
    values = oriented(yaw_rad, slope_rad, 1.01)  # rounded, so not quite of length 1
    assert slope(imu)(values) == pytest.approx(slope_rad)
    values = oriented(yaw_rad, slope_rad)
    assert heading(imu)(values) == pytest.approx(yaw_rad) == heading_of(values, imu)


def test_an_orientation_that_is_not_measured_is_none(imu: Topic) -> None:
    values = oriented(0.4, 0.1) | {"orientation_covariance[0]": -1.0}
    assert math.isnan(slope(imu)(values)) and math.isnan(heading(imu)(values))
    values["orientation_covariance[0]"] = 0.01
    assert slope(imu)(values) == pytest.approx(0.1)
    zeros = {f"orientation.{axis}": 0.0 for axis in "xyzw"}
    assert math.isnan(slope(imu)(zeros))


def test_a_topic_without_an_orientation_has_no_heading(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        '[[topics]]\nname = "/odom"\nspeed_mps = "twist.twist.linear.x"\n'
    )
    topic = load_topics(tmp_path / "mine.toml").topics[0]
    assert math.isnan(heading_of({}, topic)) and math.isnan(heading(topic)({}))


def test_the_forward_acceleration_unless_there_is_none(imu: Topic) -> None:
    values = {"linear_acceleration.x": 0.7, "linear_acceleration.y": 9.0}
    assert acceleration(imu)(values) == 0.7
    assert acceleration(imu)(values | {"linear_acceleration_covariance[0]": 0.0}) == 0.7
    assert math.isnan(acceleration(imu)(values | {"linear_acceleration_covariance[0]": -1.0}))


def test_a_field_is_taken_with_its_factor_and_a_pose_as_it_is(imu: Topic) -> None:
    assert field_value(imu, "yaw_rate_radps")({"angular_velocity.z": 0.25}) == -0.5
    assert east_m({POSE[0]: 3.0, POSE[1]: 4.0}) == 3.0
