"""A rover in MuJoCo: motors drive wheels on ground, without formulas for the effects.

Scrub in turns, slip, inertia, and the power of payload, slope and soft ground follow from contact
and motor torques. Left wheels come before right ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.concealed.plants.motion import Array
from benchmarks.concealed.plants.rover_drives import TICKS_PER_S
from benchmarks.concealed.plants.vehicles import GRAVITY_MPS2

TRACK_M = 0.55  # as rover.xml has it, and the manual of a Husky
WHEEL_RADIUS_M = 0.165  # as rover.xml has it, and husky_description
WHEELS_KG = 10.0  # all four, as rover.xml has them
THRUST_N_PER_A = 21.2  # as the preset husky has it
STEP_S = 0.1  # between samples of a recording; chosen: five ticks
_TICK_S = 1.0 / TICKS_PER_S
_SETTLING_S = 6.0  # before a recording: half of it speeding up, half at the first speed; chosen
# a skid-steered robot turns more slowly than its wheels would have it, by about this factor
_SPREAD = 1.8
_HEADING_GAIN_HZ = 2.0  # yaw rate over the error of heading; chosen: half a second to correct one

Brake = Callable[[Array, float], Array]
"""Torque of friction in the four wheels, N m, for their speeds, m/s, and the yaw rate that is asked
for, rad/s."""


@dataclass(frozen=True)
class Ground:
    """Ground under the wheels."""

    sliding: float  # coefficient of friction
    rolling: float  # rolling friction over the wheel's radius


@dataclass(frozen=True)
class World:
    """Ground along x: patches of other ground, and the slope, positive upwards along x, linear
    between knots."""

    ground: Ground
    patches: tuple[tuple[float, float, Ground], ...] = ()  # from and to, m
    slope: tuple[tuple[float, float], ...] = ((0.0, 0.0),)  # place, m; slope, rad

    def below(self, place_m: float) -> Ground:
        """Ground at a place."""
        return next(
            (ground for start, end, ground in self.patches if start <= place_m < end), self.ground
        )


@dataclass(frozen=True)
class Rover:
    """Parameters of a rover."""

    mass_kg: float  # without payload
    efficiency: float  # of the motors and gears
    idle_w: float
    recovery: float = 0.0  # share of the braking energy that the battery gets back


@dataclass(frozen=True)
class Trip:
    """Commands of one run; arrays of shape (n,) at 50 Hz, where the first values also hold before
    the start."""

    speed_mps: Array
    yaw_radps: Array
    payload_kg: Array
    world: World
    start_m: float = 0.0
    heading_rad: float = 0.0


@dataclass(frozen=True)
class Log:
    """Noise-free measurements of one run; arrays of shape (n,), means over a tenth of a second."""

    speed_mps: Array
    wheel_left_mps: Array
    wheel_right_mps: Array
    yaw_radps: Array
    heading_rad: Array
    place_m: Array
    grade_rad: Array
    power_w: Array
    left_a: Array
    right_a: Array

    @property
    def time_s(self) -> Array:
        """Time since the start, s."""
        return np.asarray(np.arange(self.speed_mps.size) * STEP_S)


def drive(rover: Rover, trip: Trip, brake: Brake | None = None) -> Log:
    """Simulate one run; the recording starts when the rover drives steadily at the first commanded
    speed."""
    cart = _Cart(rover, trip, brake)
    gentle = np.linspace(0.0, 1.0, round(_SETTLING_S / _TICK_S / 2))
    for share in (*gentle, *np.ones(gentle.size)):
        cart.tick(share * trip.speed_mps[0], share * trip.yaw_radps[0], trip.payload_kg[0])
    cart.place(trip.start_m, trip.heading_rad)
    asked = zip(trip.speed_mps, trip.yaw_radps, trip.payload_kg, strict=True)
    rows = np.array([cart.tick(speed, yaw, payload) for speed, yaw, payload in asked])
    ticks = round(STEP_S / _TICK_S)
    means = rows[: len(rows) // ticks * ticks].reshape(-1, ticks, rows.shape[1]).mean(axis=1)
    return Log(*np.ascontiguousarray(means.T))


class _Cart:
    """The simulated rover, with its wheel speed controllers and a compass."""

    def __init__(self, rover: Rover, trip: Trip, brake: Brake | None) -> None:
        self.rover = rover
        self.world = trip.world
        self.brake = brake
        self.knots = np.array(trip.world.slope).T
        self.model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("rover.xml")))
        self.data = mujoco.MjData(self.model)
        self.payload_kg = 0.0
        self._load("chassis", rover.mass_kg - WHEELS_KG)
        self._load("payload", 0.0)
        self.heading_rad = self.wanted_rad = 0.0
        self.place(trip.start_m, trip.heading_rad)

    def place(self, start_m: float, heading_rad: float) -> None:
        """Move the rover to a place and heading, with its velocity and tilt unchanged."""
        turn = heading_rad - self.heading_rad
        q = self.data.qpos
        v = self.data.qvel
        q[:3] = start_m, 0.0, q[2]
        half = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
        mujoco.mju_mulQuat(q[3:7], half, q[3:7].copy())
        v[:2] = v[0] * np.cos(turn) - v[1] * np.sin(turn), v[0] * np.sin(turn) + v[1] * np.cos(turn)
        self.heading_rad = heading_rad
        self.wanted_rad = self.wanted_rad + turn
        self.data.qacc_warmstart[:] = 0.0

    def tick(self, speed_mps: float, yaw_radps: float, payload_kg: float) -> tuple[float, ...]:
        """Command a speed and a yaw rate, simulate a fiftieth of a second, and return the values of
        `Log`."""
        if payload_kg != self.payload_kg:
            self._load("payload", payload_kg)
            self.payload_kg = payload_kg
        asked = self._steer(speed_mps, yaw_radps)
        grade_rad = self._stand()
        steps = round(_TICK_S / self.model.opt.timestep)
        change = (asked - self.data.ctrl) / steps
        for _ in range(steps):
            # in steps so small that the torque at the end is representative
            self.data.ctrl += change
            mujoco.mj_step(self.model, self.data)
        return self._read(grade_rad)

    def _steer(self, speed_mps: float, yaw_radps: float) -> Array:
        """Commanded speeds of the wheels, rad/s, shape (4,)."""
        standing = abs(speed_mps) < 1e-3 and abs(yaw_radps) < 1e-3
        self.wanted_rad += yaw_radps * _TICK_S
        astray = 0.0 if standing else self.wanted_rad - self.heading_rad
        half_mps = 0.5 * TRACK_M * (_SPREAD * yaw_radps + _HEADING_GAIN_HZ * astray)
        if self.brake is not None:
            self.model.dof_frictionloss[6:] = self.brake(
                WHEEL_RADIUS_M * self.data.qvel[6:], yaw_radps
            )
        return np.array([speed_mps - half_mps] * 2 + [speed_mps + half_mps] * 2) / WHEEL_RADIUS_M

    def _stand(self) -> float:
        """Set the ground under each wheel, and the slope under the robot by tilting gravity.

        Returns:
            Slope in the direction of its heading, rad.
        """
        grounds = [self.world.below(float(self.data.geom_xpos[2 + wheel, 0])) for wheel in range(4)]
        for friction, ground in zip(self.model.pair_friction, grounds, strict=True):
            friction[:2] = ground.sliding
            friction[3:] = ground.rolling * WHEEL_RADIUS_M
        slope = float(np.interp(self.data.qpos[0], *self.knots))
        self.model.opt.gravity[:] = (
            -GRAVITY_MPS2 * np.sin(slope),
            0.0,
            -GRAVITY_MPS2 * np.cos(slope),
        )
        return float(np.arcsin(np.sin(slope) * np.cos(self.heading_rad)))

    def _read(self, grade_rad: float) -> tuple[float, ...]:
        w, x, y, z = self.data.qpos[3:7]
        turned = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) - self.heading_rad
        self.heading_rad += (turned + np.pi) % (2 * np.pi) - np.pi  # continuous beyond half a turn
        east, north = self.data.qvel[:2]
        forward = east * np.cos(self.heading_rad) + north * np.sin(self.heading_rad)
        torque = self.data.actuator_force
        wheels = self.data.qvel[6:]
        work = torque * wheels
        electric = np.where(
            work > 0.0,
            work / self.rover.efficiency,
            self.rover.recovery * self.rover.efficiency * work,
        )
        amps = np.abs(torque) / (self.rover.efficiency * THRUST_N_PER_A * WHEEL_RADIUS_M)
        rims = WHEEL_RADIUS_M * wheels
        return (
            forward, rims[:2].mean(), rims[2:].mean(), self.data.qvel[5], self.heading_rad,
            self.data.qpos[0], grade_rad, self.rover.idle_w + electric.sum(), amps[:2].sum(), amps[2:].sum(),
        )  # fmt: skip

    def _load(self, body: str, mass_kg: float) -> None:
        """Set the mass of a body; its inertia scales with it."""
        number = self.model.body(body).id
        mass_kg = max(mass_kg, 1e-3)
        self.model.body_inertia[number] *= mass_kg / self.model.body_mass[number]
        self.model.body_mass[number] = mass_kg
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))
