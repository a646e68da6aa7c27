"""Channels that measure one thing twice: their ratio identifies a wrong unit, or the user is
asked."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from homeward.logs import thresholds
from homeward.logs.channels import Array
from homeward.logs.columns import RecordingError
from homeward.logs.doubts import drawn_w

WHEELS = "the wheel speeds"
PRODUCT = "voltage_v x current_a"
_UNITS: Mapping[tuple[str, str], Mapping[float, str]] = MappingProxyType({
    ("speed_mps", "distance_m"): {3.6: "km/h", 2.237: "miles per hour", 100.0: "cm/s", 1000.0: "mm/s"},
    ("speed_mps", WHEELS): {3.6: "km/h", 100.0: "cm/s", 1000.0: "mm/s"},
    ("yaw_rate_radps", "heading_rad"): {57.3: "degrees per second"},
    ("heading_rad", "yaw_rate_radps"): {57.3: "degrees"},
    (PRODUCT, "power_w"): {1e3: "millivolts or milliamperes", 1e6: "millivolts and milliamperes"},
    ("power_w", PRODUCT): {1e3: "milliwatts"},
})  # fmt: skip
"""Units of the first of two, by the ratio to the second."""
_INTEGRATED = "speed_mps", WHEELS, "yaw_rate_radps"
"""What gives an amount over time."""
_MEASURED_AS_A_WHOLE = "distance_m", "heading_rad"
"""What is an amount itself."""
_CHANNELS = {WHEELS: ("wheel_left_mps", "wheel_right_mps"), PRODUCT: ("voltage_v", "current_a")}


class Twice(NamedTuple):
    """One amount by two measurements: a way in m, an angle in rad, or a mean power in W."""

    what: str
    reference: str
    amount: float
    by_reference: float
    power_of_time: int  # with which the ratio depends on the unit of the time

    @property
    def ratio(self) -> float:
        """The amount over that by the reference."""
        return self.amount / self.by_reference

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that are compared."""
        return (
            *_CHANNELS.get(self.what, (self.what,)),
            *_CHANNELS.get(self.reference, (self.reference,)),
        )

    @property
    def powers(self) -> dict[str, int]:
        """The powers with which the ratio depends on units of channels; not of wheels, whose speeds
        are added."""
        powers = {"time_s": self.power_of_time}
        for name, power in ((self.what, 1), (self.reference, -1)):
            if name != WHEELS:
                powers |= dict.fromkeys(_CHANNELS.get(name, (name,)), power)
        return powers

    @property
    def unit(self) -> tuple[float, str] | None:
        """Factor and name of the unit that explains the ratio; None where none does."""
        for factor, unit in _UNITS[self.what, self.reference].items():
            if abs(np.log(self.ratio / factor)) < thresholds.UNIT_LOG_RATIO:
                return factor, unit
        return None

    @property
    def is_long_enough(self) -> bool:
        """Whether two ways are long enough to be compared; other amounts always are."""
        is_way = self.what in ("speed_mps", WHEELS)
        return not is_way or min(self.amount, self.by_reference) > thresholds.LEAST_ODOMETER_M

    @property
    def agree(self) -> bool:
        """Whether both agree as well as instruments do."""
        return bool(abs(np.log(self.ratio)) <= np.log(thresholds.MOST_ODOMETER_RATIO))


def measured_twice(channels: Mapping[str, Array]) -> list[Twice]:
    """What channels measure twice, each from the samples in which it is known.

    Args:
        channels: Channels in SI units with `time_s`, shape (n,) each.
    """
    amounts = _ways_and_angles(channels) | _powers(channels)
    pairs = []
    for what, reference in _UNITS:
        if amounts.get(what, 0.0) <= 0.0 or amounts.get(reference, 0.0) <= 0.0:
            continue
        # A rate over time depends on the unit of the time, what is measured as a whole does not.
        is_whole = what in _MEASURED_AS_A_WHOLE or reference in _MEASURED_AS_A_WHOLE
        pairs.append(
            Twice(
                what=what,
                reference=reference,
                amount=amounts[what],
                by_reference=amounts[reference],
                power_of_time=1 if is_whole else 0,
            )
        )
    return pairs


def _ways_and_angles(channels: Mapping[str, Array]) -> dict[str, float]:
    """Ways in m and angles turned in rad, by the channel or `WHEELS` that gives them."""
    time_s = channels["time_s"]
    rates = {name: channels[name] for name in ("speed_mps", "yaw_rate_radps") if name in channels}
    if "wheel_left_mps" in channels and "wheel_right_mps" in channels:
        rates[WHEELS] = (channels["wheel_left_mps"] + channels["wheel_right_mps"]) / 2.0
    amounts = {name: _over_time(time_s, rate) for name, rate in rates.items()}
    if "distance_m" in channels:
        amounts["distance_m"] = _travel(channels["distance_m"])
    if "heading_rad" in channels:
        heading_rad = channels["heading_rad"]
        amounts["heading_rad"] = _travel(np.unwrap(heading_rad[np.isfinite(heading_rad)]))
    return amounts


def _powers(channels: Mapping[str, Array]) -> dict[str, float]:
    """Mean sizes of the power as recorded and as voltage times current, W; {} where they are not
    both there."""
    time_s = channels["time_s"]
    factors = {
        name: _everywhere(time_s, channels[name]) for name in _CHANNELS[PRODUCT] if name in channels
    }
    product_w = drawn_w(factors)
    if "power_w" not in channels or product_w is None:
        return {}
    return {"power_w": _mean_size(channels["power_w"]), PRODUCT: _mean_size(product_w)}


def refuse_contradictions(channels: Mapping[str, Array]) -> list[str]:
    """Refuse a ratio that is a wrong unit, and ask about two odometers that differ; notes on powers
    that differ.

    Raises:
        RecordingError: The channels contradict each other.
    """
    if (
        "heading_rad" in channels
        and np.nanmax(np.abs(np.diff(channels["heading_rad"]))) > thresholds.HEADING_JUMP
    ):
        raise RecordingError(
            "heading_rad jumps by more than 180; this looks like degrees (factor 0.0174533)"
        )
    notes = []
    for pair in measured_twice(channels):
        if pair.unit is not None:
            factor, unit = pair.unit
            raise RecordingError(
                f"{pair.what} is {pair.ratio:.3g} times that of {pair.reference}; this looks like {unit} "
                f"(factor {1 / factor:.6g} in a mapping file)"
            )
        if pair.what in ("speed_mps", WHEELS) and pair.is_long_enough and not pair.agree:
            raise RecordingError(
                f"{pair.what} gives {pair.amount:.4g} m of way and {pair.reference} {pair.by_reference:.4g} m: which "
                "is right? Give the other a factor in a mapping file (--columns), or leave it out"
            )
        if pair.what == "power_w" and not pair.agree:
            notes.append(
                f"power_w is {pair.ratio:.3g} times {PRODUCT}: power_w is used; leave it out of a mapping file "
                "(--columns) if it is not that of the battery"
            )
    return notes


def _over_time(time_s: Array, rate: Array) -> float:
    """The integral of the size of a rate, from the samples in which it is known."""
    is_known = np.isfinite(rate)
    return float((np.abs(rate[is_known][:-1]) * np.diff(time_s[is_known])).sum())


def _travel(values: Array) -> float:
    """The sum of all changes, from the samples in which the value is known."""
    return float(np.abs(np.diff(values[np.isfinite(values)])).sum())


def _mean_size(values: Array) -> float:
    sizes = np.abs(values[np.isfinite(values)])
    return float(sizes.mean()) if len(sizes) else 0.0


def _everywhere(time_s: Array, values: Array) -> Array:
    """A channel at all times between its first and its last known sample."""
    is_known = np.isfinite(values)
    if not is_known.any():
        return values
    return np.asarray(
        np.interp(time_s, time_s[is_known], values[is_known], left=np.nan, right=np.nan)
    )
