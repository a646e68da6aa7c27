"""Channels whose values are possible and yet of another unit: what the data show is said, and
nothing is changed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from homeward.logs import thresholds
from homeward.logs.autocorrelation import correlation_windows
from homeward.logs.channels import Array, Index

_COUNTED = {
    "current_a": "charge (Ah)", "motor_left_a": "charge (Ah)", "motor_right_a": "charge (Ah)", "power_w": "energy (Wh)",
}  # fmt: skip
"""What a counter in place of a channel counts."""


def doubts(channels: Mapping[str, Array]) -> dict[str, str]:
    """What speaks against the unit or the meaning of channels, a line each, by channel.

    Args:
        channels: Channels in SI units with `time_s`, shape (n,) each.
    """
    lines = {
        "heading_rad": _in_degrees(channels),
        "temperature_c": _in_fahrenheit(channels),
        "soc": _used_for_left(channels),
        **{name: _counter(name, channels) for name in _COUNTED},
    }
    return {name: line for name, line in lines.items() if line is not None}


def turned_slopes(
    climb_mps: Array, speed_mps: Array, power_w: Array, run: Index, weight_n: float, name: str
) -> str | None:
    """Whether the energy of climbs shows that slopes have the wrong sign; a phrase, or None.

    Climbing takes at least the robot's weight along the slope. Where power falls with the climbing
    rate by more than half of that, clearly more than its residuals explain, uphill was recorded as
    negative.

    Args:
        climb_mps: Rate of climbing by the slopes as recorded, means over windows, shape (windows,).
        speed_mps: Speed without its sign.
        power_w: Power drawn.
        run: Run of each window.
        weight_n: Weight of the robot, N.
        name: Its name.
    """
    causes = np.stack((climb_mps, np.ones(len(speed_mps)), speed_mps), axis=-1)
    if np.linalg.matrix_rank(causes) < causes.shape[1]:
        causes = causes[:, :2]  # at one speed
    if np.linalg.matrix_rank(causes) < causes.shape[1] or len(causes) < thresholds.FEWEST_CLIMBS:
        return None
    coefficients = np.linalg.lstsq(causes, power_w, rcond=None)[0]
    force_n = float(coefficients[0])  # along the slope: power for each m/s of climbing
    residual_w = power_w - causes @ coefficients
    # Windows that depend on those before count for less: the variance grows by their
    # autocorrelation time.
    degrees_of_freedom = len(residual_w) - causes.shape[1]
    variance = (
        float(residual_w @ residual_w) / degrees_of_freedom * correlation_windows(residual_w, run)
    )
    # The first row of the pseudoinverse: its square is that entry of the inverse of causes.T @
    # causes, which may be singular in double precision where causes are not, as at a speed that is
    # constant but for rounding.
    gain = np.linalg.pinv(causes)[0]
    error_n = float(np.sqrt(variance * (gain @ gain)))
    is_small = force_n > -thresholds.SHARE_OF_WEIGHT * weight_n
    is_unclear = force_n > -thresholds.CLEAR_CLIMB * error_n
    if is_small or is_unclear:
        return None
    return (
        f"climbs draw less than level ground, taken all together ({force_n:.3g} N along the slope, where the weight "
        f"of {name} asks for at least {weight_n:.3g} N): is uphill positive? (factor -1 in a mapping file)"
    )


def drawn_w(channels: Mapping[str, Array]) -> Array | None:
    """Power drawn, W, as recorded or as voltage times current; None where neither is there."""
    if "power_w" in channels:
        return channels["power_w"]
    if "voltage_v" in channels and "current_a" in channels:
        return np.asarray(channels["voltage_v"] * channels["current_a"])
    return None


def _known(channels: Mapping[str, Array], name: str) -> Array:
    values = channels.get(name, np.empty(0))
    return np.asarray(values[np.isfinite(values)])


def _in_degrees(channels: Mapping[str, Array]) -> str | None:
    heading_rad = _known(channels, "heading_rad")
    if not len(heading_rad) or abs(heading_rad[0]) <= 2.0 * np.pi:
        return None
    return (
        f"heading_rad begins at {heading_rad[0]:.4g}, beyond one turn in rad: is it in degrees? "
        "(factor 0.0174533 in a mapping file)"
    )


def _in_fahrenheit(channels: Mapping[str, Array]) -> str | None:
    temperature_c = _known(channels, "temperature_c")
    if not len(temperature_c) or np.median(temperature_c) <= thresholds.HOTTEST_AIR_C:
        return None
    return (
        f"temperature_c has a median of {np.median(temperature_c):.3g}, hotter than any air on earth: is it in "
        "Fahrenheit (factor 0.555556, offset -17.7778 in a mapping file), or that of a motor?"
    )


def _used_for_left(channels: Mapping[str, Array]) -> str | None:
    soc = _known(channels, "soc")
    power_w = drawn_w(channels)
    if len(soc) < 2 or power_w is None or not np.isfinite(power_w).any():
        return None
    mean_w = float(np.nanmean(power_w))
    steps = np.diff(soc)
    rises_mostly = (steps > 0.0).sum() > (steps < 0.0).sum()
    if mean_w <= 0.0 or soc[-1] - soc[0] <= thresholds.SOC_RISE or not rises_mostly:
        return None
    energy_j = mean_w * float(np.ptp(channels["time_s"]))
    return (
        f"soc rises from {soc[0]:.3g} to {soc[-1]:.3g} while {energy_j / 1e3:.3g} kJ are drawn: is it the charge used? "
        "(a negative factor, and offset = 1, in a mapping file)"
    )


def _counter(name: str, channels: Mapping[str, Array]) -> str | None:
    steps = np.diff(_known(channels, name))
    rises = int((steps > 0.0).sum())
    falls = int((steps < 0.0).sum())
    if min(rises, falls) > 0 or max(rises, falls) < thresholds.COUNTS:
        return None
    how = (
        f"rises {rises} times and never falls" if rises else f"falls {falls} times and never rises"
    )
    return f"{name} {how}: is it a counter of {_COUNTED[name]}? A mapping file (--columns) names another column"
