"""The simulated robot: its battery by the physics, its messages in the conventions of ROS 2."""

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.companion import CompanionError
from homeward.logs.bags.grade import uphill, yaw
from homeward.physics import load_robot, mission_energy
from homeward.watch.ros2 import simulated
from homeward.watch.ros2.simulated import Args, main

HUSKY = load_robot("husky")


@pytest.mark.parametrize(("speed_mps", "slope_rad"), [(0.8, 0.0), (0.3, 0.05), (0.8, -0.3)])
def test_its_power_is_that_of_eq_7(speed_mps: float, slope_rad: float) -> None:
    expected_w = float(mission_energy(HUSKY, 100.0, speed_mps, slope_rad)) * speed_mps / 100.0
    assert simulated._power(HUSKY, speed_mps, slope_rad) == pytest.approx(expected_w)


def quaternion(given: Any) -> Any:
    return np.array([[given.x], [given.y], [given.z], [given.w]])


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi, 0.7])
@pytest.mark.parametrize("slope_rad", [0.0, 0.03, -0.2])
def test_its_messages_are_what_they_are_read_as(yaw_rad: float, slope_rad: float) -> None:
    battery, odometry, imu = simulated._contents(
        1234.25, 250.0, 0.81234, 7.5, yaw_rad, slope_rad, 0.8
    )
    # Discharging is negative in sensor_msgs/BatteryState.
    assert battery["voltage"] * battery["current"] == pytest.approx(-250.0)  # type: ignore[operator]
    assert battery["percentage"] == 0.812
    pose: Any = odometry["pose"]
    assert (pose.pose.position.x, pose.pose.position.y) == (7.5, 0.0)
    assert odometry["twist"].twist.linear.x == 0.8  # type: ignore[attr-defined]
    flat, tilted = quaternion(pose.pose.orientation), quaternion(imu["orientation"])
    for one, slope in ((flat, 0.0), (tilted, slope_rad)):
        assert np.linalg.norm(one) == pytest.approx(1.0)
        assert np.arcsin(uphill(one))[0] == pytest.approx(slope, abs=1e-12)
        assert math.cos(yaw(one)[0] - yaw_rad) == pytest.approx(1.0)
    stamp: Any = imu["header"]
    assert (stamp.stamp.sec, stamp.stamp.nanosec) == (1234, 250_000_000)


class Recorder:
    """Publishers that keep what is written, with the clock that they are given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.written: dict[str, list[Any]] = {}
        self.now_s = 5000.0
        monkeypatch.setattr(simulated, "DomainParticipant", lambda domain: None)
        monkeypatch.setattr(simulated, "Topic", lambda participant, name, kind: name)
        monkeypatch.setattr(
            simulated, "DataWriter", lambda participant, topic, qos: self.writer(topic)
        )
        monkeypatch.setattr(simulated, "time", self)

    def writer(self, name: str) -> Any:
        kept = self.written.setdefault(name, [])

        class Writer:
            write = staticmethod(kept.append)

        return Writer

    def time(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def test_it_drives_to_and_fro_and_its_battery_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(monkeypatch)
    main(Args(hz=10.0, seconds=8.0, speed=0.5, out_s=4.0, x=20.0, soc=0.5))
    odometry = recorder.written["rt/odom"]
    x_m = np.array([one.pose.pose.position.x for one in odometry])
    assert len(x_m) == 80 and recorder.now_s == pytest.approx(5000.0 + 7.9)
    assert x_m.max() == pytest.approx(22.0) and x_m[-1] == pytest.approx(20.0)
    np.testing.assert_allclose(np.abs(np.diff(x_m)), 0.05)
    battery = recorder.written["rt/battery_state"]
    assert battery[0].percentage == 0.5
    slopes = (
        0.03 * np.sin(np.array([20.0, *x_m[:-1]]) / 40.0) * np.where(np.arange(80) < 40, 1.0, -1.0)
    )
    power_w = [-one.voltage * one.current for one in battery]
    np.testing.assert_allclose(power_w, mission_energy(HUSKY, 0.5, 0.5, slopes), rtol=1e-5)


def test_messages_are_lost_by_chance_and_the_clock_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(monkeypatch)
    main(Args(hz=100.0, seconds=10.0, lost=0.3, jump_at_s=5.0, jump_s=-3600.0, seed=1))
    for kept in recorder.written.values():
        assert 0.64 < len(kept) / 1000 < 0.76
    stamps = np.array(
        [
            one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec
            for one in recorder.written["rt/imu"]
        ]
    )
    early = stamps[stamps >= 5000.0]
    assert early.max() < 5005.0 and (stamps < 5000.0).sum() > 300
    assert stamps.min() == pytest.approx(5005.0 - 3600.0, abs=0.1)


@pytest.mark.parametrize(
    "wrong",
    [{"hz": 0.0}, {"lost": 1.1}, {"lost": -0.1}, {"speed": 0.0}, {"speed": 1.01}, {"out_s": 0.0}],
)
def test_what_it_cannot_do_takes_one_line(wrong: dict[str, float]) -> None:
    with pytest.raises(CompanionError, match=r"^give --hz and --out-s above 0, .*, up to 1 m/s$"):
        main(Args(**wrong))  # type: ignore[arg-type]
