"""A simulated robot that publishes like a real one, to try `homeward watch --ros2` without one.

`python -m homeward.watch.ros2.simulated --robot husky` drives to and fro, by the physics of the
robot's file, and publishes battery state, odometry and IMU, best effort.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from dataclasses import dataclass

from homeward import cli, installed

if __name__ == "__main__":
    installed.needed("ros2", "cyclonedds", "rosbags")

import numpy as np
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from homeward.companion import CompanionError
from homeward.physics import Robot, RobotError, ancillary_power, load_robot, model
from homeward.physics.battery import charge_share, energy_share
from homeward.watch.ros2.idl import message, struct_of

# chosen: near a Husky's 24 V and a Jackal's 25.6 V; readers multiply it by the current
_VOLTAGE_V = 25.0
_TOPICS = {
    "/battery_state": "sensor_msgs/msg/BatteryState", "/odom": "nav_msgs/msg/Odometry", "/imu": "sensor_msgs/msg/Imu",
}  # fmt: skip


@dataclass(frozen=True)
class Args:
    """Behaviour of the simulated robot."""

    robot: str = "husky"
    """Preset or robot file."""
    domain: int = 0
    """ROS 2 domain."""
    hz: float = 20.0
    """Messages of each topic a second."""
    seconds: float = float("inf")
    """Duration."""
    speed: float = 0.8
    """Speed, m/s."""
    out_s: float = 600.0
    """Time for which it drives one way, s."""
    x: float = 0.0
    """Start of its odometry, m."""
    soc: float = 1.0
    """State of charge at the start."""
    lost: float = 0.0
    """Share of lost messages."""
    jump_at_s: float = float("inf")
    """Time at which the clock of its stamps jumps, s after the start."""
    jump_s: float = 0.0
    """Size of that jump, s."""
    seed: int = 0
    """Seed of the lost messages."""


def main(args: Args) -> None:
    """Drive and publish.

    Raises:
        RobotError: The robot does not exist.
        CompanionError: Another argument is invalid.
        DDSException: The domain cannot be joined.
    """
    robot = load_robot(args.robot)
    _check(args, robot)
    participant = DomainParticipant(args.domain)
    sensor = Qos(
        Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(5),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )  # fmt: skip
    writers = {
        name: DataWriter(participant, Topic(participant, f"rt{name}", struct_of(kind)), qos=sensor)
        for name, kind in _TOPICS.items()
    }
    rng = np.random.default_rng(args.seed)
    began_s = time.time()
    energy_j = float(energy_share(robot.curve, args.soc)) * robot.usable_energy_j
    x_m = args.x
    for tick in itertools.count():
        since_s = tick / args.hz
        if since_s >= args.seconds:
            return
        time.sleep(max(began_s + since_s - time.time(), 0.0))
        is_on_way_back = (since_s // args.out_s) % 2 == 1
        slope_rad = 0.03 * math.sin(x_m / 40.0)  # of the ground, in the direction of x
        yaw_rad = 0.0
        if is_on_way_back:
            slope_rad = -slope_rad
            yaw_rad = math.pi
        power_w = _power(robot, args.speed, slope_rad)
        energy_j -= power_w / args.hz
        x_m += math.cos(yaw_rad) * args.speed / args.hz
        stamp_s = began_s + since_s
        if since_s >= args.jump_at_s:
            stamp_s += args.jump_s
        soc = float(charge_share(robot.curve, energy_j / robot.usable_energy_j))
        contents = _contents(stamp_s, power_w, soc, x_m, yaw_rad, slope_rad, args.speed)
        for (name, kind), content in zip(_TOPICS.items(), contents, strict=True):
            if rng.random() >= args.lost:
                writers[name].write(message(kind, **content))


def _check(args: Args, robot: Robot) -> None:
    """Refuse arguments that no robot can follow."""
    has_rates = args.hz > 0.0 and args.out_s > 0.0 and 0.0 <= args.lost <= 1.0
    if not has_rates or not 0.0 < args.speed <= robot.max_speed_mps:
        raise CompanionError(
            f"give --hz and --out-s above 0, --lost from 0 to 1, and --speed above 0, up to {robot.max_speed_mps:g} m/s"
        )


def _power(robot: Robot, speed_mps: float, slope_rad: float) -> float:
    """Power out of the battery, W."""
    force_n = model.traction_force(robot, speed_mps, slope_rad)
    return float(model.drive_power(robot, force_n, speed_mps) + ancillary_power(robot, 0.0))


def _contents(
    stamp_s: float,
    power_w: float,
    soc: float,
    x_m: float,
    yaw_rad: float,
    slope_rad: float,
    speed_mps: float,
) -> list[dict[str, object]]:
    """Fields of battery state, odometry and IMU."""
    stamp = message(
        "builtin_interfaces/msg/Time", sec=int(stamp_s), nanosec=int(stamp_s % 1.0 * 1e9)
    )
    header = message("std_msgs/msg/Header", stamp=stamp, frame_id="odom")
    # Halves of the angles, of which quaternions are made; a positive pitch looks down.
    sin_yaw = math.sin(0.5 * yaw_rad)
    cos_yaw = math.cos(0.5 * yaw_rad)
    sin_pitch = math.sin(-0.5 * slope_rad)
    cos_pitch = math.cos(-0.5 * slope_rad)
    flat = message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=sin_yaw, w=cos_yaw)
    tilted = message(
        "geometry_msgs/msg/Quaternion",
        x=-sin_yaw * sin_pitch, y=cos_yaw * sin_pitch, z=sin_yaw * cos_pitch, w=cos_yaw * cos_pitch,
    )  # fmt: skip
    still = {"x": 0.0, "y": 0.0, "z": 0.0}
    place = message(
        "geometry_msgs/msg/Pose",
        position=message("geometry_msgs/msg/Point", **(still | {"x": x_m})),
        orientation=flat,
    )
    twist = message(
        "geometry_msgs/msg/Twist", linear=message("geometry_msgs/msg/Vector3", **(still | {"x": speed_mps})),
        angular=message("geometry_msgs/msg/Vector3", **still),
    )  # fmt: skip
    return [
        {"header": header, "voltage": _VOLTAGE_V, "current": -power_w / _VOLTAGE_V, "percentage": round(soc, 3),
         "present": True},
        {"header": header, "pose": message("geometry_msgs/msg/PoseWithCovariance", pose=place),
         "twist": message("geometry_msgs/msg/TwistWithCovariance", twist=twist)},
        {"header": header, "orientation": tilted},
    ]  # fmt: skip


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (RobotError, CompanionError, DDSException)))
