"""A recording with uneven stamps on an even clock.

A phone or a bus hands over values in bursts: some stamps lie hundredths of a second apart, the next after a second. A
rate of change from stamp to stamp is then noise over next to nothing, and a mean over samples is that of the bursts.
"""

import dataclasses

import numpy as np

from homeward.diagnosis import thresholds
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording

_ANGLES = ("heading_rad",)  # jump by a turn


def on_even_clock(recording: Recording, shortest_s: float) -> tuple[Recording, str | None]:
    """The recording on an even clock, and what was done in a phrase; as it is, and None, if its stamps are even.

    Each value is the mean, over one tick, of the straight lines between samples. The tick is the median step, and at
    least `shortest_s`. Ticks in gaps are left out.
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
    recorded = steps_s[step] < thresholds.GAP * tick_s
    channels = {"time_s": middle_s[recorded]}
    for name, values in recording.channels.items():
        if name != "time_s":
            channels[name] = _means(name, values, time_s, edges_s)[recorded]
    given = recording.channels
    if "voltage_v" in given and "current_a" in given:  # the mean power is that of their product
        power_w = _means("power_w", given["voltage_v"] * given["current_a"], time_s, edges_s)[recorded]
        channels["current_a"] = power_w / np.where(channels["voltage_v"] > 0.0, channels["voltage_v"], np.nan)
    says = f"its stamps are uneven ({short_s:.2g} to {long_s:.2g} s): every channel is averaged over {tick_s:.2g} s"
    return dataclasses.replace(recording, channels=channels), says


def _means(name: str, values: Array, time_s: Array, edges_s: Array) -> Array:
    """Mean of a channel between edges, shape (edges - 1,), NaN where most of it was not recorded."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(edges_s) - 1, np.nan)
    given = np.unwrap(values[known]) if name in _ANGLES else values[known]
    filled: Array = np.interp(time_s, time_s[known], given)
    share = _integral(known.astype(np.float64), time_s, edges_s) / np.diff(edges_s)
    return np.where(share >= thresholds.HALF, _integral(filled, time_s, edges_s) / np.diff(edges_s), np.nan)


def _integral(values: Array, time_s: Array, edges_s: Array) -> Array:
    """Integral of the straight lines between samples from each edge to the next, shape (edges - 1,)."""
    until = np.concatenate(([0.0], np.cumsum((values[1:] + values[:-1]) / 2.0 * np.diff(time_s))))
    step = np.clip(np.searchsorted(time_s, edges_s, side="right") - 1, 0, len(time_s) - 2)
    since_s = edges_s - time_s[step]
    slope = (values[step + 1] - values[step]) / (time_s[step + 1] - time_s[step])
    return np.asarray(np.diff(until[step] + values[step] * since_s + slope * since_s**2 / 2.0))
