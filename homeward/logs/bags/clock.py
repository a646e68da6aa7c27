"""One clock for topics that come at different rates.

The clock is that of the slower of power and motion, whose samples are used unchanged. Faster topics
are averaged around each tick, halfway to its neighbours; slower ones, such as a state of charge,
are interpolated linearly. Nothing is interpolated across a gap: there the value is missing.
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from homeward.logs import thresholds
from homeward.logs.channels import Array
from homeward.logs.times import median_step_s


def in_order(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Known samples sorted by time, one for each time."""
    is_known = np.isfinite(values)
    unique_s, places = np.unique(time_s[is_known], return_index=True)
    return unique_s, values[is_known][places]


def slower(*times: Array) -> Array:
    """The times of the slowest topic, over the time that all cover."""
    start_s = max(time_s[0] for time_s in times)
    end_s = min(time_s[-1] for time_s in times)
    slowest = max(times, key=median_step_s)
    clock: Array = slowest[(slowest >= start_s) & (slowest <= end_s)]
    if len(clock) < 2:
        return clock
    stride = max(round(thresholds.FASTEST_CLOCK_S / median_step_s(clock)), 1)
    return clock[::stride]


def on_clock(time_s: Array, values: Array, clock_s: Array) -> Array:
    """A channel at the ticks of a clock: its mean from halfway to the tick before to halfway to the
    one after.

    Args:
        time_s, values: Its samples as `in_order` gives them, linear in between, shape (n,).
        clock_s: Ticks, s, increasing, shape (ticks,).
    """
    if len(time_s) < 2:
        return np.full(len(clock_s), np.nan)
    tick_s = median_step_s(clock_s)
    nearest = np.minimum(np.searchsorted(time_s, clock_s), len(time_s) - 1)
    if np.array_equal(
        time_s[nearest], clock_s
    ) and tick_s < thresholds.THINNED_STEPS * median_step_s(time_s):
        return values[nearest]  # the channel that the clock is of
    # Half the width of the mean around each tick, (ticks,): symmetric, and as far as the channel
    # goes.
    half_s = np.minimum(0.5 * np.diff(clock_s), 0.5 * tick_s)
    half_s = np.minimum(np.append(half_s, half_s[-1:]), np.append(half_s[:1], half_s))
    half_s = np.minimum(half_s, np.minimum(clock_s - time_s[0], time_s[-1] - clock_s))
    is_inside = half_s >= 0.0
    half_s = np.maximum(half_s, 0.0)
    start_s = clock_s - half_s
    end_s = clock_s + half_s
    integral = make_interp_spline(time_s, values, k=1).antiderivative()
    has_width = half_s > 0.0
    means = np.interp(clock_s, time_s, values)
    means[has_width] = (integral(end_s[has_width]) - integral(start_s[has_width])) / (
        2.0 * half_s[has_width]
    )
    # How many gaps lie before each sample: two with the same number have none between them.
    steps_s = np.diff(time_s)
    is_gap = steps_s > thresholds.GAP_STEPS * max(median_step_s(time_s), tick_s)
    gaps_before = np.concatenate(([0], np.cumsum(is_gap)))
    after_start = np.clip(np.searchsorted(time_s, start_s, side="right"), 1, len(steps_s))
    after_end = np.clip(np.searchsorted(time_s, end_s, side="right"), 1, len(steps_s))
    has_no_gap = gaps_before[after_end] == gaps_before[after_start - 1]
    return np.asarray(np.where(is_inside & has_no_gap, means, np.nan))
