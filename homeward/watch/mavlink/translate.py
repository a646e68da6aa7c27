"""MAVLink's messages as the messages of ROS 2 that the topic mappings know, in its units and axes
(REP 103).

Values that mean unknown stay what they are, in SI (65.535 V, -0.01 A): `homeward.logs.unknown`
knows them, as in files. MAVLink has x north, y east and z down, and angles clockwise from north
(common.xml).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from homeward import thresholds as shared
from homeward.logs.bags.topics import BATTERY, IMU
from homeward.logs.unknown import unknown
from homeward.watch import thresholds
from homeward.watch.online.listener import ODOMETRY

EARTH_RADIUS_M = 6_371_008.8  # mean radius of the earth (IUGG)
_VOLT, _AMPERE, _SHARE = 1e-3, 1e-2, 1e-2  # units of batteries: mV, cA and per cent
_DEGREE, _MPS, _M = 1e-7, 1e-2, 1e-3  # units of positions: 1e-7 degrees, cm/s and mm
_WINDS = 100  # winds that are kept for a mean; chosen: some seconds
_CENTIDEGREE_RAD = math.radians(1e-2)

KINDS = {
    "BATTERY_STATUS": BATTERY, "SYS_STATUS": BATTERY, "ATTITUDE": IMU, "GLOBAL_POSITION_INT": ODOMETRY,
    "LOCAL_POSITION_NED": ODOMETRY,
}  # fmt: skip
"""Types of what is translated, by the name of the message, which is that of its topic."""


class Translated(NamedTuple):
    """A message of ROS 2.

    Attributes:
        topic: Name of the MAVLink message.
        content: An object with the fields of its type.
    """

    topic: str
    content: Any


class Translator:
    """Translates the messages of one vehicle, and keeps its attitude, home and wind.

    Positions are metres east and north of home, or of the first position while home is not known.

    Attributes:
        boots: How often the autopilot has started again, by its clock.
        home_deg: Latitude and longitude of the autopilot's home, degrees; None until it is
            received.
        origin_deg: Latitude and longitude of the origin of the positions, degrees.
        winds_mps: Wind as received: components towards where it comes from, east and north.
    """

    SAVED: ClassVar = ("origin_deg",)

    def __init__(self) -> None:
        self.boots = 0
        self.home_deg: tuple[float, float] | None = None
        self.origin_deg: tuple[float, float] | None = None
        self.winds_mps: list[tuple[float, float]] = []
        self._home_local_m = 0.0, 0.0  # north and east in the frame of LOCAL_POSITION_NED
        self._is_fixed = False
        self._by_satellites = False
        self._clock_s = 0.0
        self._turned: Rotation | None = None  # by the last attitude
        self._tells_batteries = False
        self._translators: dict[str, Callable[[Any], SimpleNamespace | None]] = {
            "BATTERY_STATUS": self._battery_status, "SYS_STATUS": self._sys_status, "ATTITUDE": self._attitude,
            "GLOBAL_POSITION_INT": self._global_position_int, "LOCAL_POSITION_NED": self._local_position_ned,
            "HOME_POSITION": self._home_position, "WIND": self._wind, "WIND_COV": self._wind_cov,
        }  # fmt: skip

    def see(self, message: Any) -> Translated | None:
        """A message of the vehicle, None if it is no reading or holds nothing that is known."""
        self._see_clock(message)
        kind = message.get_type()
        content = self._translators[kind](message) if kind in self._translators else None
        return None if content is None else Translated(kind, content)

    def fix_frame(self) -> None:
        """Keep the frame of the positions from now on, whatever is received: their message, and
        where home is."""
        self._is_fixed = True

    def _see_clock(self, message: Any) -> None:
        """Notice a start of the autopilot: messages overtake each other by less."""
        if hasattr(message, "time_boot_ms"):
            clock_s = 1e-3 * message.time_boot_ms
            if clock_s < self._clock_s - thresholds.JUMP_S:
                self.boots += 1
            self._clock_s = clock_s

    def _battery_status(self, message: Any) -> SimpleNamespace:
        """Sum of the voltages of the cells, or of the parts that ArduPilot writes where it knows no
        cells."""
        self._tells_batteries = True
        cells_v = _VOLT * np.array(message.voltages, np.float64)
        cells_v = cells_v[~unknown("voltage_v", cells_v)]
        further_v = _VOLT * np.array(message.voltages_ext, np.float64)  # 0 where there is none
        voltage_v = (
            cells_v.sum() + further_v[~unknown("voltage_v", further_v)].sum()
            if len(cells_v)
            else math.nan
        )
        battery = _battery(voltage_v, message)
        battery.location = str(message.id)
        return battery

    def _sys_status(self, message: Any) -> SimpleNamespace | None:
        """The first battery again, used where no BATTERY_STATUS is sent."""
        return None if self._tells_batteries else _battery(_VOLT * message.voltage_battery, message)

    def _attitude(self, message: Any) -> SimpleNamespace | None:
        angles_rad = message.yaw, message.pitch, message.roll
        if not all(map(math.isfinite, angles_rad)):
            return None
        self._turned = _rotation(*angles_rad)
        return SimpleNamespace(
            header=_header(message), orientation=_quaternion(self._turned), orientation_covariance=[0.0],
            angular_velocity=_vector(message.rollspeed, -message.pitchspeed, -message.yawspeed),
            linear_acceleration=_vector(0.0, 0.0, 0.0), linear_acceleration_covariance=[-1.0],
        )  # fmt: skip

    def _global_position_int(self, message: Any) -> SimpleNamespace | None:
        if message.lat == 0 and message.lon == 0:  # as autopilots send it without a fix
            return None
        # first found on the way: another frame than the one in use
        if self._is_fixed and not self._by_satellites:
            return None
        self._by_satellites = True
        place_deg = _DEGREE * message.lat, _DEGREE * message.lon
        if self.origin_deg is None:
            self.origin_deg = place_deg
        east_m, north_m = metres_from(self.origin_deg, place_deg)
        heading_rad = _CENTIDEGREE_RAD * message.hdg
        turned = self._turned
        if turned is None and not unknown("heading_rad", np.array(heading_rad)):
            turned = _rotation(heading_rad, 0.0, 0.0)
        velocity_mps = _MPS * message.vx, _MPS * message.vy
        return _odometry(message, (east_m, north_m, _M * message.alt), velocity_mps, turned)

    def _local_position_ned(self, message: Any) -> SimpleNamespace | None:
        if self._by_satellites or not all(
            map(math.isfinite, (message.x, message.y, message.vx, message.vy))
        ):
            return None
        north_m, east_m = self._home_local_m
        place_m = message.y - east_m, message.x - north_m, -message.z
        return _odometry(message, place_m, (message.vx, message.vy), self._turned)

    def _home_position(self, message: Any) -> None:
        if message.latitude == 0 and message.longitude == 0:
            return
        home_deg = _DEGREE * message.latitude, _DEGREE * message.longitude
        if self.home_deg is None and not self._is_fixed:
            self.origin_deg = home_deg
            if math.isfinite(message.x) and math.isfinite(message.y):
                self._home_local_m = message.x, message.y
        self.home_deg = home_deg

    def _wind(self, message: Any) -> None:
        """Of ArduPilot: the direction that it comes from, degrees clockwise from north."""
        from_rad = math.radians(message.direction)
        self._see_wind(message.speed * math.sin(from_rad), message.speed * math.cos(from_rad))

    def _wind_cov(self, message: Any) -> None:
        """Of PX4: the velocity of the air, north and east."""
        self._see_wind(-message.wind_y, -message.wind_x)

    def _see_wind(self, east_mps: float, north_mps: float) -> None:
        if math.hypot(east_mps, north_mps) <= shared.MOST_WIND_MPS:  # NaN is unknown
            self.winds_mps = [*self.winds_mps[1 - _WINDS :], (east_mps, north_mps)]


def metres_from(
    origin_deg: tuple[float, float], place_deg: tuple[float, float]
) -> tuple[float, float]:
    """Metres east and north of an origin, both as latitude and longitude in degrees, on a sphere.

    >>> [round(metres) for metres in metres_from((60.0, 179.99), (60.01, -179.99))]
    [1112, 1112]
    """
    north_rad = math.radians(place_deg[0] - origin_deg[0])
    east_rad = math.remainder(math.radians(place_deg[1] - origin_deg[1]), math.tau)
    return EARTH_RADIUS_M * math.cos(
        math.radians(origin_deg[0])
    ) * east_rad, EARTH_RADIUS_M * north_rad


def _battery(voltage_v: float, message: Any) -> SimpleNamespace:
    """Current positive when charging, as BatteryState has it; MAVLink has it positive when
    discharging."""
    return SimpleNamespace(
        voltage=voltage_v,
        current=-_AMPERE * message.current_battery,
        percentage=_SHARE * message.battery_remaining,
    )


def _odometry(
    message: Any,
    place_m: tuple[float, float, float],
    velocity_mps: tuple[float, float],
    turned: Rotation | None,
) -> SimpleNamespace:
    """A pose with the speed along the heading, which is negative in reverse; without a heading its
    size."""
    north_mps, east_mps = velocity_mps
    speed_mps = math.hypot(north_mps, east_mps)
    orientation = _vector(0.0, 0.0, 0.0, 0.0)  # which is no rotation
    if turned is not None:
        forward_east, forward_north, _ = turned.apply((1.0, 0.0, 0.0))
        level = math.hypot(forward_east, forward_north)
        speed_mps = (
            (forward_east * east_mps + forward_north * north_mps) / level if level else speed_mps
        )
        orientation = _quaternion(turned)
    pose = SimpleNamespace(position=_vector(*place_m), orientation=orientation)
    twist = SimpleNamespace(linear=_vector(speed_mps, 0.0, 0.0), angular=_vector(0.0, 0.0, 0.0))
    return SimpleNamespace(
        header=_header(message), pose=SimpleNamespace(pose=pose), twist=SimpleNamespace(twist=twist)
    )


def _rotation(yaw_rad: float, pitch_rad: float, roll_rad: float) -> Rotation:
    """A rotation from x forward, y left, z up, to x east, y north, z up."""
    return Rotation.from_euler("ZYX", (0.5 * math.pi - yaw_rad, -pitch_rad, roll_rad))


def _header(message: Any) -> SimpleNamespace:
    whole_s, rest_ms = divmod(message.time_boot_ms, 1000)
    return SimpleNamespace(stamp=SimpleNamespace(sec=whole_s, nanosec=rest_ms * 10**6))


def _quaternion(turned: Rotation) -> SimpleNamespace:
    return _vector(*turned.as_quat())


def _vector(*values: float) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip("xyzw", values, strict=False)))
