"""Words and values that mean "unknown", in one table for files and live input.

Programs and autopilots write them where nothing was measured. A mapping names further ones for a
column or field: `voltage_v = { column = "U", unknown = [-1, "off"] }`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from homeward.logs import thresholds
from homeward.logs.channels import Array, Mask

WORDS = frozenset({
    "--.--", "-.-", "--", "---", "-", "?", "*", "n/a", "na", "nan", "null", "none", "nil", "unknown", "invalid", "void",
    "undefined", "no data", "not available", "#n/a",
})  # fmt: skip
"""Texts, in lower case. "--.--" is that of QGroundControl (Fact.cc), the others of spreadsheets and
loggers."""

VALUES: Mapping[str, tuple[float, ...]] = MappingProxyType({
    "voltage_v": (65.535, 65535.0, -1.0, -0.001),
    "current_a": (655.35, 327.67, -327.68, -0.01),
    "power_w": (65535.0,),
    "speed_mps": (655.35, 65535.0),
    "soc": (-0.01, -1.0, 2.55, 255.0),
    "heading_rad": (11.43801525, 1143.80152530),  # 655.35 and 65535 degrees
    "temperature_c": (327.67, -327.68, -273.15),
    "elevation_m": (-32768.0, 32767.0, -9999.0, -999.0, -99999.0),
})  # fmt: skip
"""Values by channel, SI. Sources: MAVLink, common.xml: UINT16_MAX mV, cm/s, cdeg, -1 % and -1 cA
are "not provided", INT16_MAX cdegC; MAVROS gives them as 65.535 V and -0.01; heights of SRTM and
GeoTIFF are -32768 and -9999 where unknown."""

_EQUAL = 1e-6  # relative; of numbers that were single precision


def unknown(channel: str, values: Array) -> Mask:
    """Which values of a channel, SI, mean that it is unknown."""
    marked = np.zeros(np.shape(values), np.bool_)
    for value in VALUES.get(channel, ()):
        marked |= np.isclose(values, value, rtol=_EQUAL, atol=0.0)
    if channel == "elevation_m":
        marked |= zero_heights(values)
    return marked


def zero_heights(elevation_m: Array) -> Mask:
    """Heights of 0 among others that are all far from it: a receiver without a fix writes them."""
    is_zero: Mask = np.asarray(elevation_m == 0.0)
    sizes_m = np.abs(elevation_m[~is_zero & np.isfinite(elevation_m)])
    are_far = len(sizes_m) > 0 and sizes_m.min() >= thresholds.NEAR_ZERO_M
    if is_zero.mean() > thresholds.MOST_ZERO_HEIGHTS or not are_far:
        return np.zeros(np.shape(elevation_m), np.bool_)
    return is_zero


def left_out(channel: str, values: Array) -> list[str]:
    """Set values that mean unknown to NaN, in place; a note if there are some."""
    marked = unknown(channel, values)
    if not marked.any():
        return []
    marks = " and ".join(f"{value:g}" for value in np.unique(values[marked]))
    values[marked] = np.nan
    return [
        f"{int(marked.sum())} of {len(values)} values of {channel} are {marks}, which means unknown: left out"
    ]
