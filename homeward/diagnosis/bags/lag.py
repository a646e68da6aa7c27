"""By how much power is recorded later than the motion it goes with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MOST_S = 2.0
_STEPS = 81
_MOST_TICKS = 5000
_FEWEST_TICKS = 60
_LEAST_R2 = 0.05


@dataclass(frozen=True)
class Lag:
    """A shift in time.

    Attributes:
        lag_s: Time by which the power reading is late, s; None where no shift fits better than others.
        half_width_s: Half of the width of its 95 % interval, s.
        r2: Share of the power's variation that the motion explains with this shift.
    """

    lag_s: float | None
    half_width_s: float
    r2: float

    def __str__(self) -> str:
        if self.lag_s is None:
            return "no lag between power and motion can be seen in this bag"
        which = "later" if self.lag_s >= 0.0 else "earlier"
        return (
            f"power is recorded {abs(self.lag_s):.2f} s {which} than motion (95 %: within {self.half_width_s:.2f} s; "
            f"R^2 {self.r2:.3f}); it is left as it is"
        )


_UNSEEN = Lag(None, float("nan"), float("nan"))


def estimate_lag(clock_s: Array, power: Array, motion_s: Array, speed_mps: Array, yaw_rate_radps: Array | None) -> Lag:
    """The shift with which motion explains power best.

    For shifts of up to 2 s each way, power is regressed on speed, speed times acceleration and turning rate (least
    squares, all of them means over a tick of the clock), and the shift with the least sum of squares is taken, refined
    by a parabola whose width gives the interval. What remains counts as fewer samples where it has a memory.

    Args:
        clock_s, power: Samples of power or current, shape (n,).
        motion_s, speed_mps, yaw_rate_radps: Motion at its own rate, shape (m,).
    """
    good = np.isfinite(power)
    clock_s, power = clock_s[good], power[good]
    every = max(len(clock_s) // _MOST_TICKS, 1)
    if len(clock_s) < _FEWEST_TICKS or len(motion_s) < _FEWEST_TICKS:
        return _UNSEEN
    tick_s = float(np.median(np.diff(clock_s)))
    clock_s, power = clock_s[::every], power[::every]
    inner = (clock_s >= motion_s[0] + _MOST_S + tick_s) & (clock_s <= motion_s[-1] - _MOST_S - tick_s)
    clock_s, power = clock_s[inner], power[inner]
    if len(clock_s) < _FEWEST_TICKS or np.ptp(power) == 0.0:
        return _UNSEEN
    accel = np.gradient(speed_mps, motion_s)
    features = [np.abs(speed_mps), np.maximum(speed_mps * accel, 0.0), np.minimum(speed_mps * accel, 0.0)]
    features += [] if yaw_rate_radps is None else [np.abs(yaw_rate_radps)]
    integrals = [_integral(motion_s, np.nan_to_num(values)) for values in features]
    shifts = np.linspace(-_MOST_S, _MOST_S, _STEPS)
    left = [_left(clock_s - shift, power, motion_s, integrals, tick_s) for shift in shifts]
    squares = np.array([float(one @ one) for one in left])
    best = int(squares.argmin())
    r2 = 1.0 - squares[best] / float(((power - power.mean()) ** 2).sum())
    if best in (0, _STEPS - 1) or r2 < _LEAST_R2:
        return _UNSEEN
    before, here, after = squares[best - 1 : best + 2]
    step_s, bend = shifts[1] - shifts[0], before - 2.0 * here + after
    if bend <= 0.0:
        return _UNSEEN
    rest = left[best]
    memory = float(np.clip((rest[1:] @ rest[:-1]) / max(here, 1e-300), 0.0, 0.99))
    variance = here / len(rest) * (1.0 + memory) / (1.0 - memory)
    half_width_s = 1.96 * float(np.sqrt(2.0 * variance / bend)) * step_s
    if half_width_s > 0.5 * _MOST_S:
        return _UNSEEN
    return Lag(float(shifts[best] + 0.5 * (before - after) / bend * step_s), half_width_s, float(r2))


def _integral(time_s: Array, values: Array) -> Array:
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))))


def _left(ticks_s: Array, power: Array, motion_s: Array, integrals: list[Array], tick_s: float) -> Array:
    """What motion does not explain of the power, shape (ticks,)."""
    means = [
        (np.interp(ticks_s + 0.5 * tick_s, motion_s, one) - np.interp(ticks_s - 0.5 * tick_s, motion_s, one)) / tick_s
        for one in integrals
    ]
    columns = np.column_stack((np.ones(len(power)), *means))
    rest: Array = power - columns @ np.linalg.lstsq(columns, power, rcond=None)[0]
    return rest
