"""Replay of a recorded drive through the kernel: the battery power that the model predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.physics.effects import turning
from homeward.physics.jit import announce_compilation, compiled
from homeward.physics.kernel import CAUSES, Conditions, advance, full_charge
from homeward.physics.robot import Robot


@dataclass(frozen=True)
class Replay:
    """The model's prediction of a drive; arrays of shape (n,), one value per sample, for the step
    that starts there."""

    power_w: NDArray[np.float64]  # battery power
    drive_w: NDArray[np.float64]  # electrical power into the drive
    # force at the wheels along the way, negative where the robot brakes
    traction_n: NDArray[np.float64]
    # force of the motors: traction that is not negative, and scrub in turns
    wheel_force_n: NDArray[np.float64]
    energy_j: dict[str, float]  # battery energy by cause over the whole drive


@dataclass(frozen=True)
class Recorded:
    """Conditions of a recorded drive in the form of the kernel."""

    time_s: NDArray[np.float64]  # (n,)
    samples: NDArray[np.float64]  # (conditions, n), roughness 0 where it is the robot file's
    usual_roughness: bool

    def replay(self, robot: Robot) -> Replay:
        """Drive a robot through these conditions."""
        record = robot.record()
        samples = self.samples
        usual_roughness = float(record["surface_usual"][0])
        if self.usual_roughness and usual_roughness != 0.0:
            samples = samples.copy()
            samples[Conditions._fields.index("roughness")] = usual_roughness
        output = np.empty((4, len(self.time_s)))
        state = full_charge(robot, np.inf)
        # a robot that moves at the first sample does not start there
        state["speed_mps"] = abs(samples[0, 0])
        _replay(record, state, self.time_s, samples, output)
        power_w, drive_w, traction_n, wheel_force_n = output
        energy_j = dict(zip(CAUSES, state["ledger_j"][0].tolist(), strict=True))
        return Replay(
            power_w=power_w,
            drive_w=drive_w,
            traction_n=traction_n,
            wheel_force_n=wheel_force_n,
            energy_j=energy_j,
        )


def replay(
    robot: Robot,
    time_s: NDArray[np.float64],
    speed_mps: Any,
    *,
    grade_rad: Any = 0.0,
    yaw_rate_radps: Any = 0.0,
    accel_mps2: Any = None,
    headwind_mps: Any = 0.0,
    roughness: Any = None,
    temperature_c: Any = 20.0,
    sensing_hz: Any = 0.0,
    base_distance_m: Any = 0.0,
    direction: Any = None,
) -> Replay:
    """Drive a robot through recorded conditions.

    Each sample holds until the next; the last one holds as long as the one before. The battery does
    not run out: a recording shows that it did not. Driving backwards (negative speed) draws what
    driving forwards down the reversed slope draws.

    Args:
        robot: The robot.
        time_s: Times of the samples, s, increasing, shape (n,), n at least 2.
        speed_mps: Speed, m/s, shape (n,) or a number, like all that follow.
        grade_rad: Slope angle along the direction of forward travel, rad.
        yaw_rate_radps: Turning rate, rad/s.
        accel_mps2: Acceleration along the direction of forward travel, m/s^2; central differences
            of the speed if left out: their work sums to the change of kinetic energy, where
            one-sided ones would gain or lose some.
        headwind_mps: Wind against the direction of travel, m/s.
        roughness: Surface roughness, 0 where C_rr was measured; the robot file's typical roughness
            if left out.
        temperature_c: Air temperature, C.
        sensing_hz: Sensing rate, Hz.
        base_distance_m: Distance from base, m.
        direction: 1 on the way out and -1 on the way home, for the effect `hidden_grade`; if left
            out, whether the distance from base grows or falls and, where that does not change,
            whether the robot drives forwards.

    Raises:
        ValueError: Times do not increase or there are fewer than two; a channel has another length,
            or a value that is not finite; a direction is neither 1 nor -1.
    """
    recorded = conditions(
        time_s, speed_mps, grade_rad=grade_rad, yaw_rate_radps=yaw_rate_radps, accel_mps2=accel_mps2,
        headwind_mps=headwind_mps, roughness=roughness, temperature_c=temperature_c, sensing_hz=sensing_hz,
        base_distance_m=base_distance_m, direction=direction,
    )  # fmt: skip
    return recorded.replay(robot)


def conditions(
    time_s: NDArray[np.float64], speed_mps: Any, *, grade_rad: Any, yaw_rate_radps: Any, accel_mps2: Any,
    headwind_mps: Any, roughness: Any, temperature_c: Any, sensing_hz: Any, base_distance_m: Any, direction: Any,
) -> Recorded:  # fmt: skip
    """Conditions of a recorded drive, in which several robots can be replayed; arguments and errors
    as of `replay`."""
    time_s = np.ascontiguousarray(time_s, dtype=np.float64)
    if (
        time_s.ndim != 1
        or len(time_s) < 2
        or not np.isfinite(time_s).all()
        or not (np.diff(time_s) > 0.0).all()
    ):
        raise ValueError("time_s must hold at least two increasing times in seconds")
    announce_compilation()
    speed_mps = np.broadcast_to(_channel("speed_mps", speed_mps, time_s), time_s.shape)
    base_distance_m = np.broadcast_to(
        _channel("base_distance_m", base_distance_m, time_s), time_s.shape
    )
    grade_rad = _channel("grade_rad", grade_rad, time_s)
    if accel_mps2 is None:
        accel_mps2 = np.gradient(speed_mps, time_s)
    usual_roughness = roughness is None
    if usual_roughness:
        roughness = 0.0  # until a robot is replayed, whose file says it
    channels = Conditions(
        speed_mps=speed_mps,
        sensing_hz=_channel("sensing_hz", sensing_hz, time_s),
        accel_mps2=_channel("accel_mps2", accel_mps2, time_s),
        sin_grade=np.sin(grade_rad),
        cos_grade=np.cos(grade_rad),
        yaw_rate_radps=_channel("yaw_rate_radps", yaw_rate_radps, time_s),
        roughness=_channel("roughness", roughness, time_s),
        headwind_mps=_channel("headwind_mps", headwind_mps, time_s),
        temperature_c=_channel("temperature_c", temperature_c, time_s),
        base_distance_m=base_distance_m,
        direction=_direction(direction, base_distance_m, speed_mps, time_s),
    )
    samples = np.empty((len(channels), len(time_s)))
    for row, values in zip(samples, channels, strict=True):
        row[:] = values
    return Recorded(time_s, samples, usual_roughness)


def _channel(name: str, values: Any, time_s: NDArray[np.float64]) -> Any:
    channel = np.asarray(values, dtype=np.float64)
    if channel.shape not in ((), time_s.shape):
        raise ValueError(
            f"{name} has shape {channel.shape}; allowed: one number or shape {time_s.shape}, as time_s"
        )
    gaps = np.flatnonzero(~np.isfinite(channel))
    if len(gaps):
        sample = int(gaps[0])
        raise ValueError(
            f"{name} = {channel.flat[sample]} at sample {sample} is not finite; fill or cut the gap first"
        )
    return channel


def _direction(
    direction: Any, base_distance_m: Any, speed_mps: Any, time_s: NDArray[np.float64]
) -> Any:
    """The direction as recorded or, if it was not (None), by the distance from base or the
    speed."""
    if direction is not None:
        direction = _channel("direction", direction, time_s)
        wrong = direction[np.abs(direction) != 1.0]
        if len(wrong):
            raise ValueError(
                f"direction = {wrong[0]:g} is not allowed; give 1 on the way out and -1 on the way home"
            )
        return direction
    growth = np.gradient(base_distance_m, time_s)
    changing = growth != 0.0
    if not changing.any():
        return np.where(speed_mps < 0.0, -1.0, 1.0)
    # Where the distance is constant, the direction is that before or, at the start, that after.
    sample = np.where(changing, np.arange(len(time_s)), changing.argmax())
    latest_change = np.maximum.accumulate(sample)
    return np.sign(growth[latest_change])


@compiled
def _replay(robots: Any, states: Any, time_s: Any, samples: Any, output: Any) -> None:
    p = robots[0]
    s = states[0]
    (
        speed,
        sensing,
        accel,
        sine,
        cosine,
        yaw_rate,
        roughness,
        headwind,
        temperature,
        distance,
        direction,
    ) = samples
    for i in range(len(time_s)):
        # Backwards a robot meets the slope and the acceleration with the other sign.
        forward = 1.0 if speed[i] >= 0.0 else -1.0
        x = Conditions(
            abs(speed[i]),
            sensing[i],
            forward * accel[i],
            forward * sine[i],
            cosine[i],
            yaw_rate[i],
            roughness[i],
            headwind[i],
            temperature[i],
            distance[i],
            direction[i],
        )
        end = min(i + 1, len(time_s) - 1)  # the last sample holds as long as the one before
        dt_s = time_s[end] - time_s[end - 1]
        advance(p, s, x, dt_s)
        output[0, i] = s.power_w
        output[1, i] = s.drive_w
        output[2, i] = s.traction_n
        output[3, i] = np.maximum(s.traction_n, 0.0)
        if p.turning_scrub != 0.0:
            output[3, i] += turning.wheel_force(p, x)
