"""The grade from an IMU or from odometry, positive where the robot's front points up; and its
heading.

Methods, the first that a bag allows:

1. `orientation` of an IMU whose driver fills it in: how far the robot's forward axis points up,
   `sin(grade) = 2 (x z - w y)` for the quaternion x, y, z, w, averaged over `_ORIENTATION_S`.
2. `acceleration` of an IMU: an accelerometer measures the slope plus the robot's own acceleration,
   `sin(grade) = (a_x - dv/dt) / g`, averaged over `ACCELERATION_S`, with the speed from the
   odometry.
3. Orientation of the odometry, where it is not planar.

An IMU that is not mounted level adds a constant. It is not removed: a route need not be level on
average either. Axes as in REP 103: x forward, y left, z up.
"""

import numpy as np
import pandas as pd

from homeward.logs import thresholds
from homeward.logs.channels import Array

GRAVITY_MPS2 = 9.80665  # standard gravity (ISO 80000-3), as in `homeward.physics.model`
_ORIENTATION_S = 1.0  # means over so long: chosen above the pitching of a robot on its wheels
ACCELERATION_S = 2.0  # the same of an accelerometer, which is noisier: chosen twice as long


def from_orientation(time_s: Array, quaternion: Array) -> Array | None:
    """Grade from quaternions x, y, z, w, shape (4, n), rad, or None where they are missing or
    planar."""
    sine = uphill(quaternion)
    if (
        np.isfinite(sine).mean() < thresholds.ORIENTED_SHARE
        or np.nanmax(np.abs(sine)) < thresholds.PLANAR
    ):
        return None
    return np.arcsin(_smoothed(time_s, sine, _ORIENTATION_S))


def uphill(quaternion: Array) -> Array:
    """Sine of the inclination of the forward axis, from quaternions as above; NaN where one is not
    a rotation."""
    length = np.linalg.norm(quaternion, axis=0)
    is_rotation = np.abs(length - 1.0) < thresholds.UNIT_LENGTH_ERROR
    x, y, z, w = quaternion / np.where(is_rotation, length, np.nan)
    return np.asarray(2.0 * (x * z - w * y))


def heading(quaternion: Array) -> Array | None:
    """Direction of the robot's forward axis, rad counter-clockwise, not wrapped, from quaternions
    as above, or None."""
    length_error = np.abs(np.linalg.norm(quaternion, axis=0) - 1.0)
    turns = np.any(np.abs(quaternion[2]) > thresholds.PLANAR)
    if not turns or np.any(length_error > thresholds.UNIT_LENGTH_ERROR):
        return None
    return np.asarray(np.unwrap(yaw(quaternion)))


def yaw(quaternion: Array) -> Array:
    """Direction of the forward axis, rad counter-clockwise, from quaternions as above."""
    x, y, z, w = quaternion
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def from_acceleration(
    time_s: Array, forward_mps2: Array, motion_s: Array, speed_mps: Array
) -> Array | None:
    """Grade from the specific force along the forward axis, rad, or None where it is zero
    throughout.

    Args:
        time_s, forward_mps2: Of the accelerometer, shape (n,).
        motion_s, speed_mps: Of the odometry, shape (m,).
    """
    if not np.any(forward_mps2) or len(motion_s) < 2:
        return None
    # What the robot's own change of speed adds to the slope's share of gravity.
    own_mps2 = np.gradient(_smoothed(motion_s, speed_mps, 0.5 * ACCELERATION_S), motion_s)
    uphill_mps2 = forward_mps2 - np.interp(time_s, motion_s, own_mps2)
    sine = _smoothed(time_s, uphill_mps2, ACCELERATION_S) / GRAVITY_MPS2
    return np.arcsin(np.clip(sine, -1.0, 1.0))


def _smoothed(time_s: Array, values: Array, width_s: float) -> Array:
    """Mean over a window around each sample, missing values left out."""
    series = pd.Series(values, pd.to_timedelta(time_s, unit="s"))
    return (
        series.rolling(pd.Timedelta(seconds=width_s), center=True, closed="both")
        .mean()
        .to_numpy(np.float64)
    )
