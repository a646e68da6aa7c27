"""One clock for topics that come at different rates.

The clock is that of the slower of power and motion, whose samples are used unchanged. Faster topics are averaged around
each tick, halfway to its neighbours; slower ones, such as a state of charge, are interpolated linearly. Nothing is
interpolated across a gap: there the value is missing.
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from homeward.logs import thresholds
from homeward.logs.channels import Array
from homeward.logs.times import median_step_s


def in_order(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Known samples sorted by time, one for each time."""
    is_known = np.isfinite(values)
    times, first = np.unique(time_s[is_known], return_index=True)
    return times, values[is_known][first]


def slower(*times: Array) -> Array:
    """The times of the slowest topic, over the time that all cover."""
    start, end = max(time_s[0] for time_s in times), min(time_s[-1] for time_s in times)
    slowest = max(times, key=median_step_s)
    clock: Array = slowest[(slowest >= start) & (slowest <= end)]
    if len(clock) < 2:
        return clock
    stride = max(round(thresholds.FASTEST_CLOCK_S / median_step_s(clock)), 1)
    return clock[::stride]


def on_clock(time_s: Array, values: Array, clock_s: Array) -> Array:
    """A channel at the ticks of a clock: its mean from halfway to the tick before to halfway to the one after.

    Args:
        time_s, values: Its samples as `in_order` gives them, linear in between, shape (n,).
        clock_s: Ticks, s, increasing, shape (ticks,).
    """
    if len(time_s) < 2:
        return np.full(len(clock_s), np.nan)
    tick_s = median_step_s(clock_s)
    nearest = np.minimum(np.searchsorted(time_s, clock_s), len(time_s) - 1)
    if np.array_equal(time_s[nearest], clock_s) and tick_s < thresholds.THINNED_STEPS * median_step_s(time_s):
        return values[nearest]  # the channel that the clock is of
    half = np.minimum(0.5 * np.diff(clock_s), 0.5 * tick_s)
    half = np.minimum(np.append(half, half[-1:]), np.append(half[:1], half))
    half = np.minimum(half, np.minimum(clock_s - time_s[0], time_s[-1] - clock_s))  # as far as the channel goes
    inside = half >= 0.0
    half = np.maximum(half, 0.0)
    start = clock_s - half
    end = clock_s + half
    steps = np.diff(time_s)
    integral = make_interp_spline(time_s, values, k=1).antiderivative()
    has_width = half > 0.0
    means = np.interp(clock_s, time_s, values)
    means[has_width] = (integral(end[has_width]) - integral(start[has_width])) / (2.0 * half[has_width])
    gap = np.concatenate(([0], np.cumsum(steps > thresholds.GAP_STEPS * max(median_step_s(time_s), tick_s))))
    first = np.clip(np.searchsorted(time_s, start, side="right"), 1, len(steps))
    last = np.clip(np.searchsorted(time_s, end, side="right"), 1, len(steps))
    return np.asarray(np.where(inside & (gap[last] == gap[first - 1]), means, np.nan))
