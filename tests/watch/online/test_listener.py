"""From messages to readings: the same decisions as for bags, as they come."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="needs the extra logs")

from homeward.diagnosis import RecordingError
from homeward.logs.bags.topics import Topics, load_topics
from homeward.watch.online.listener import Heard, Listener

BATTERY, ODOMETRY, IMU = (
    "sensor_msgs/msg/BatteryState",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/Imu",
)
TWIST = "geometry_msgs/msg/TwistStamped"
ROBOT = {"/battery_state": BATTERY, "/odom": ODOMETRY, "/imu": IMU}
LEVEL = (0.0, 0.0, 0.0, 1.0)


def header(time_s: float) -> SimpleNamespace:
    return SimpleNamespace(
        stamp=SimpleNamespace(sec=int(1000.0 + time_s), nanosec=round(time_s % 1.0 * 1e9))
    )


def vector(*values: float) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip("xyzw", values, strict=False)))


def battery(
    time_s: float, voltage: float = 24.0, current: float = -5.0, percentage: float = math.nan
) -> Any:
    return SimpleNamespace(
        header=header(time_s), voltage=voltage, current=current, percentage=percentage
    )


def odometry(time_s: float, x: float, speed: float = 1.0, yaw: float = 0.2) -> Any:
    pose = SimpleNamespace(
        position=vector(x, 0.0, 0.0),
        orientation=vector(0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)),
    )
    twist = SimpleNamespace(linear=vector(speed, 0.0, 0.0), angular=vector(0.0, 0.0, 0.0))
    return SimpleNamespace(
        header=header(time_s), pose=SimpleNamespace(pose=pose), twist=SimpleNamespace(twist=twist)
    )


def imu(
    time_s: float, orientation: tuple[float, ...] = LEVEL, forward: float = 0.0, known: bool = True
) -> Any:
    return SimpleNamespace(
        header=header(time_s), orientation=vector(*orientation), angular_velocity=vector(0.0, 0.0, 0.0),
        linear_acceleration=vector(forward, 0.0, 9.8), orientation_covariance=[0.0 if known else -1.0],
        linear_acceleration_covariance=[0.0],
    )  # fmt: skip


class Bench:
    """A listener that is fed at 10 Hz."""

    def __init__(self, found: dict[str, str] = ROBOT, mapping: Topics | None = None) -> None:
        self.listener = Listener(mapping, max_speed_mps=1.0)
        self.listener.offer(found)
        self.tick = 0

    def feed(self, ticks: int, **messages: Any) -> Heard | None:
        """Messages by the names of their topics, made for each moment; what was heard last."""
        heard = None
        for _ in range(ticks):
            time_s = 0.1 * self.tick
            for name, make in messages.items():
                self.listener.hear(f"/{name}", make(time_s), 1, time_s)
            heard = self.listener.take(time_s)
            self.tick += 1
        return heard


def drive(time_s: float) -> Any:
    return odometry(time_s, time_s)


def test_a_reading_of_battery_odometry_and_imu() -> None:
    pitch = -0.1
    bench = Bench()
    heard = bench.feed(
        30, battery_state=lambda t: battery(t, percentage=0.5), odom=drive,
        imu=lambda t: imu(t, (0.0, math.sin(0.5 * pitch), 0.0, math.cos(0.5 * pitch))),
    )  # fmt: skip
    assert heard is not None and heard.time_s == pytest.approx(2.9)
    reading = heard.reading
    assert reading["speed_mps"] == 1.0 and (reading["voltage_v"], reading["current_a"]) == (
        24.0,
        5.0,
    )
    assert reading["soc"] == 0.5 and reading["position"] == pytest.approx((2.9, 0.0))
    assert reading["heading_rad"] == pytest.approx(0.2) and reading["grade_rad"] == pytest.approx(
        0.1
    )
    assert bench.listener.sources["grade"] == "/imu" and bench.listener.warnings(2.9) == []


def test_messages_of_a_moment_are_taken_together() -> None:
    bench = Bench()
    bench.feed(25, battery_state=battery, odom=drive)
    for k in range(4):
        bench.listener.hear("/battery_state", battery(2.5, current=-float(k)), 1, 2.5)
    heard = bench.feed(1, odom=drive)
    assert heard is not None and heard.reading["current_a"] == 1.5


def test_in_the_first_moments_nothing_is_believed() -> None:
    assert Bench().feed(20, battery_state=battery, odom=drive) is None


def test_without_motion_time_goes_on_and_silence_is_said() -> None:
    bench = Bench()
    bench.feed(30, battery_state=battery, odom=drive)
    assert bench.feed(60, battery_state=battery) is None
    silence = bench.listener.silence(8.9)
    assert silence.time_s == pytest.approx(7.9) and math.isnan(silence.reading["speed_mps"])
    assert silence.reading["current_a"] == 5.0 and "position" not in silence.reading
    assert bench.listener.warnings(8.9) == ["nothing on /odom for 6 s"]
    heard = bench.feed(1, odom=drive)
    assert heard is not None and heard.time_s == pytest.approx(9.0)


def test_a_current_that_flows_the_wrong_way_is_turned() -> None:
    bench = Bench()
    heard = bench.feed(90, battery_state=lambda t: battery(t, current=5.0), odom=drive)
    assert heard is not None and heard.reading["current_a"] == 5.0
    assert (
        "/battery_state gives the current positive when discharging"
        in bench.listener.warnings(9.0)[0]
    )
    charging = Bench()
    heard = charging.feed(
        90, battery_state=lambda t: battery(t, current=5.0), odom=lambda t: odometry(t, 0.0, 0.0)
    )
    assert (
        heard is not None
        and "current_a" not in heard.reading
        and charging.listener.warnings(9.0) == []
    )


@pytest.mark.parametrize("current", [0.0, math.nan])
def test_what_is_not_measured_is_nothing(current: float) -> None:
    heard = Bench().feed(
        30, battery_state=lambda t: battery(t, current=current, percentage=math.nan), odom=drive
    )
    assert heard is not None and not {"current_a", "power_w", "soc"} & set(heard.reading)


def test_per_cent_is_told_from_a_share() -> None:
    heard = Bench().feed(30, battery_state=lambda t: battery(t, percentage=87.0), odom=drive)
    assert heard is not None and heard.reading["soc"] == pytest.approx(0.87)


def test_a_charge_is_heard() -> None:
    bench = Bench()
    bench.feed(25, battery_state=lambda t: battery(t, percentage=0.2), odom=drive)
    heard = bench.feed(1, battery_state=lambda t: battery(t, percentage=1.0), odom=drive)
    assert heard is not None and heard.charged == 1.0 and not heard.by_charger
    assert bench.listener.warnings(2.6) == ["the battery was charged or swapped: 100%"]


def test_a_current_into_a_battery_that_stands_is_a_charger() -> None:
    bench = Bench()
    bench.feed(25, battery_state=lambda t: battery(t, percentage=0.2), odom=drive)
    stands = {"odom": lambda t: odometry(t, 2.5, 0.0)}
    bench.feed(1, battery_state=lambda t: battery(t, current=3.0, percentage=0.25), **stands)
    heard = bench.feed(1, battery_state=lambda t: battery(t, current=3.0, percentage=0.6), **stands)
    assert heard is not None and heard.charged == 0.6 and heard.by_charger
    assert bench.listener.warnings(2.7) == ["the battery was charged: 60%"]
    again = bench.feed(1, battery_state=lambda t: battery(t, percentage=0.6), odom=drive)
    assert again is not None and again.charged is None and not again.by_charger


def test_the_topic_that_the_mapping_prefers_speaks_as_soon_as_it_does() -> None:
    bench = Bench({"/odom": ODOMETRY, "/odometry/filtered": ODOMETRY, "/battery_state": BATTERY})
    bench.feed(25, odom=drive)
    filtered = bench.feed(
        5, **{"odometry/filtered": lambda t: odometry(t, 50.0, 0.5), "odom": drive}
    )
    assert filtered is not None and filtered.reading["speed_mps"] == 0.5
    assert (
        bench.listener.sources["speed_mps"] == "/odometry/filtered"
        and bench.feed(5, odom=drive) is None
    )


def test_a_direction_has_no_mean() -> None:
    """By an IMU, around the west."""
    mapping = {"/odom": ODOMETRY, "/imu": IMU}
    bench = Bench(mapping)
    bench.feed(25, odom=lambda t: odometry(t, t, yaw=0.0))
    for yaw in (3.1, -3.1):
        turned = (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
        bench.listener.hear("/imu", imu(2.5, turned), 1, 2.5)
    heard = bench.feed(1, odom=lambda t: odometry(t, t, yaw=0.0))
    assert heard is not None and heard.reading["heading_rad"] == pytest.approx(-3.1)


def test_a_topic_that_seldom_comes_is_not_silent_in_between() -> None:
    bench = Bench()
    for _ in range(4):
        bench.feed(1, battery_state=battery, odom=drive)
        bench.feed(59, odom=drive)
        assert bench.listener.warnings(0.1 * bench.tick) == []
    bench.feed(400, odom=drive)
    assert bench.listener.warnings(0.1 * bench.tick) == ["nothing on /battery_state for 46 s"]


def test_in_reverse_the_slope_is_the_other_way_round() -> None:
    tilted = (0.0, math.sin(-0.05), 0.0, math.cos(0.05))
    heard = Bench().feed(30, odom=lambda t: odometry(t, -t, -1.0), imu=lambda t: imu(t, tilted))
    assert heard is not None and heard.reading["grade_rad"] == pytest.approx(-0.1)


def test_an_accelerometer_gives_the_slope_where_there_is_no_orientation() -> None:
    """Uphill by 0.05 rad while speeding up by 0.2 m/s^2."""
    felt = 9.80665 * math.sin(0.05) + 0.2
    heard = Bench().feed(
        50,
        odom=lambda t: odometry(t, 0.1 * t * t, 0.2 * t),
        imu=lambda t: imu(t, forward=felt, known=False),
    )
    assert heard is not None and heard.reading["grade_rad"] == pytest.approx(0.05, abs=1e-3)


def test_turning_rates_give_the_heading_where_nothing_else_does() -> None:
    def twist(time_s: float) -> Any:
        return SimpleNamespace(
            header=header(time_s),
            twist=SimpleNamespace(linear=vector(1.0, 0.0, 0.0), angular=vector(0.0, 0.0, 0.5)),
        )

    heard = Bench({"/twist": TWIST}).feed(50, twist=twist)
    assert heard is not None and "position" not in heard.reading
    assert heard.reading["heading_rad"] == pytest.approx(0.5 * 0.1 * 30)


def test_the_clock_of_receipt_where_the_mapping_says_so(tmp_path: Any) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        '[[topics]]\nname = "/odom"\nstamp = "receive"\nspeed_mps = "twist.twist.linear.x"\n'
    )
    heard = Bench(mapping=load_topics(file)).feed(30, odom=lambda t: odometry(3.0 * t, t))
    assert heard is not None and heard.time_s == pytest.approx(2.9)


def test_a_field_that_is_not_there_is_said(tmp_path: Any) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[[topics]]\nname = "/odom"\nspeed_mps = "twist.linear.x"\n')
    with pytest.raises(RecordingError, match=r"no field 'linear' of 'twist\.linear\.x'"):
        Bench(mapping=load_topics(file)).feed(1, odom=drive)
