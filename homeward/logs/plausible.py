"""Readings that no motion explains: what wheels' grip and a robot's top speed allow, channel by
channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from homeward.logs import thresholds
from homeward.logs.channels import CHANNELS, MOTION, Array, Index, Mask, Recording
from homeward.logs.times import median_step_s


def leave_out_spikes(channels: Mapping[str, Array]) -> list[str]:
    """Set readings to NaN from and to which a channel would change faster than possible; a note for
    each channel.

    A reading is compared with the median of those around it, not with its neighbour: differences
    from stamp to stamp are noise. Many of them are no spikes, but another unit or a wrong clock,
    which is said and left as it is.
    """
    notes = []
    half_s = thresholds.SPIKE_SAMPLES // 2 * median_step_s(channels["time_s"])
    for name, per_s in thresholds.FASTEST_CHANGES.items():
        if name not in channels:
            continue
        values = channels[name]
        known_places = np.flatnonzero(np.isfinite(values))
        if len(known_places) <= thresholds.SPIKE_SAMPLES:
            continue
        usual = median_filter(values[known_places], thresholds.SPIKE_SAMPLES, mode="nearest")
        largest_change = per_s * max(half_s, thresholds.SPIKE_S)
        spikes = known_places[np.abs(values[known_places] - usual) > largest_change]
        why = f"are more than {largest_change:.3g} {CHANNELS[name].unit} off those beside them"
        notes += _left_out(name, values, spikes, why)
    return notes


def within_top_speed(recording: Recording, max_speed_mps: float) -> Recording:
    """The recording without single speeds that its robot does not reach, and a note for each
    channel.

    Args:
        recording: The recording.
        max_speed_mps: Top speed of its robot, m/s.
    """
    channels = dict(recording.channels)
    notes = []
    fastest_mps = thresholds.FASTER_THAN_TOP * max_speed_mps
    why = f"exceed {fastest_mps:.3g} m/s, which the robot does not"
    measured = [name for names in MOTION for name in names if name in channels]
    for name in measured:
        values = channels[name].copy()
        is_too_fast: Mask = np.abs(np.nan_to_num(values)) > fastest_mps
        # more are another robot, or another unit
        if 0 < is_too_fast.sum() <= thresholds.STRAY_SHARE * len(values):
            notes += _left_out(name, values, np.flatnonzero(is_too_fast), why)
            channels[name] = values
    if not notes:
        return recording
    return replace(recording, channels=channels, notes=(*recording.notes, *notes))


def _left_out(name: str, values: Array, places: Index, why: str) -> list[str]:
    if not len(places):
        return []
    if len(places) > thresholds.STRAY_SHARE * len(values):
        return [
            f"{len(places)} of {len(values)} values of {name} {why}: too many to be spikes; check unit and clock"
        ]
    values[places] = np.nan
    return [f"{len(places)} of {len(values)} values of {name} {why}, and are left out"]
