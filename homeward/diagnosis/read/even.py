"""A recording with uneven stamps on an even clock.

A phone or a bus hands over values in bursts: some stamps lie hundredths of a second apart, the next
after a second. A rate of change from stamp to stamp is then noise over next to nothing, and a mean
over samples is that of the bursts.
"""

import dataclasses

import numpy as np

from homeward.diagnosis import thresholds
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording

_ANGLES = ("heading_rad",)  # jump by a turn


def on_even_clock(recording: Recording, shortest_s: float) -> tuple[Recording, str | None]:
    """The recording on an even clock, and what was done in a phrase; as it is, and None, if its
    stamps are even.

    Each value is the mean, over one tick, of the straight lines between samples. The tick is the
    median step, and at least `shortest_s`. Ticks in gaps are left out.
    """
    time_s = recording.channels["time_s"]
    if len(time_s) < thresholds.FEWEST_SAMPLES:
        return recording, None
    steps_s = np.diff(time_s)
    short_s, long_s = np.quantile(steps_s, [0.1, 0.9]).tolist()
    if long_s < thresholds.TWICE * short_s:
        return recording, None
    tick_s = max(shortest_s, float(np.median(steps_s)))
    edges_s = np.arange(time_s[0], time_s[-1], tick_s)
    middle_s = (edges_s[1:] + edges_s[:-1]) / 2.0
    step = np.searchsorted(time_s, middle_s) - 1
    is_recorded = steps_s[step] < thresholds.GAP * tick_s
    recorded = recording.channels
    averaged = {"time_s": middle_s[is_recorded]}
    for name, values in recorded.items():
        if name != "time_s":
            averaged[name] = _means(name, values, time_s, edges_s)[is_recorded]
    if "voltage_v" in recorded and "current_a" in recorded:
        # The mean power is the mean of the product, not the product of the means: the current makes
        # up for it.
        product_w = recorded["voltage_v"] * recorded["current_a"]
        power_w = _means("power_w", product_w, time_s, edges_s)[is_recorded]
        voltage_v = averaged["voltage_v"]
        averaged["current_a"] = power_w / np.where(voltage_v > 0.0, voltage_v, np.nan)
    phrase = f"its stamps are uneven ({short_s:.2g} to {long_s:.2g} s): every channel is averaged over {tick_s:.2g} s"
    return dataclasses.replace(recording, channels=averaged), phrase


def _means(name: str, values: Array, time_s: Array, edges_s: Array) -> Array:
    """Mean of a channel between edges, shape (edges - 1,), NaN where most of it was not
    recorded."""
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(len(edges_s) - 1, np.nan)
    readings = values[finite]
    if name in _ANGLES:
        readings = np.unwrap(readings)
    filled: Array = np.interp(time_s, time_s[finite], readings)
    ticks_s = np.diff(edges_s)
    recorded_share = _integral(finite.astype(np.float64), time_s, edges_s) / ticks_s
    means = _integral(filled, time_s, edges_s) / ticks_s
    return np.where(recorded_share >= thresholds.HALF, means, np.nan)


def _integral(values: Array, time_s: Array, edges_s: Array) -> Array:
    """Integral of the straight lines between samples from each edge to the next, shape (edges -
    1,)."""
    steps_s = np.diff(time_s)
    trapezoids = (values[1:] + values[:-1]) / 2.0 * steps_s
    until_sample = np.concatenate(([0.0], np.cumsum(trapezoids)))
    sample = np.searchsorted(time_s, edges_s, side="right") - 1  # the last one before each edge
    sample = np.clip(sample, 0, len(time_s) - 2)
    since_s = edges_s - time_s[sample]
    start = values[sample]
    rate = np.diff(values)[sample] / steps_s[sample]
    until_edge = until_sample[sample] + start * since_s + rate * since_s**2 / 2.0
    return np.asarray(np.diff(until_edge))
