"""Which way a robot drives and where on its way it is, from its distance from base and the slopes
that it meets.

The distance from base has a peak where the robot turns back, and also at the far side of a loop.
Where it turns back, the distances are the same before and after, and the slopes are met again
reversed; on a loop they are not. A sharp peak is a turn without more ado.
"""

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.noise import white_noise
from homeward.logs.channels import Array

# places before and after a peak; chosen: half or twice as many change no test of test_way.py
_COMPARED = 50
_SHIFTS = 9  # places where a turn may be, around a peak of a noisy distance; chosen, 5 or 17 alike


def along_the_way(
    base_m: Array, driven_m: Array, slope: Array | None, reach_m: float
) -> tuple[Array, Array]:
    """Direction, 1 on the way out and -1 on the way home, and place on the way, m, of each sample,
    shape (n,) each.

    A loop has no way home, and each of its laps begins at base.

    Args:
        base_m: Distance from base, shape (n,).
        driven_m: Distance driven, shape (n,).
        slope: Slope along forward travel, rad, shape (n,); None where it is not known well: then
            each peak is a turn.
        reach_m: Distance that is long against the noise of position.
    """
    driven_m = driven_m + 1e-9 * np.arange(len(driven_m))  # interpolation needs it to grow
    base_ahead_m = np.interp(driven_m + reach_m, driven_m, base_m)
    base_behind_m = np.interp(driven_m - reach_m, driven_m, base_m)
    direction = np.where(base_ahead_m < base_behind_m, -1.0, 1.0)
    place_m = base_m[0] + _passed(driven_m, direction)
    if slope is None:
        return direction, place_m
    flips = 1 + np.flatnonzero(np.diff(direction))
    # Several flips close together are one turn, or none if the direction is then as before.
    clusters = np.split(flips, 1 + np.flatnonzero(np.diff(driven_m[flips]) > reach_m))
    turns = [int(np.median(cluster)) for cluster in clusters if len(cluster) % 2]
    peaks = [0, *turns, len(base_m) - 1]
    for number, peak in enumerate(turns, start=1):
        if _turns_back(driven_m, base_m, slope, driven_m[peaks[number - 1 : number + 2]], reach_m):
            continue
        # A loop: it goes on in the same direction, from base if that is where it is.
        direction[peak:] *= -1.0
        is_at_base = base_m[peak] <= thresholds.CLOSED * float(np.ptp(base_m))
        start_m = base_m[peak] if is_at_base else place_m[peak]
        place_m[peak:] = start_m + _passed(driven_m[peak:], direction[peak:])
    return direction, place_m


def _passed(driven_m: Array, direction: Array) -> Array:
    """Way along a route since the first sample, m, shape (n,)."""
    return np.concatenate(([0.0], np.cumsum(direction[:-1] * np.diff(driven_m))))


def _turns_back(
    driven_m: Array, base_m: Array, slope: Array, peaks_m: Array, reach_m: float
) -> bool:
    """Whether the robot turns back at the second of three successive peaks; also where too little
    is known."""
    compared_m = float(np.diff(peaks_m).min()) - reach_m / 2.0
    if compared_m < 2.0 * reach_m:
        return True
    peak_m = peaks_m[1]
    around_m = np.interp(peak_m + reach_m * np.array([-1.0, 0.0, 1.0]), driven_m, base_m)
    # At a turn the distance falls on both sides by as much as the robot drives, on a smooth loop by
    # less.
    sharpness_m = 2.0 * around_m[1] - around_m[0] - around_m[2]
    if sharpness_m >= 2.0 * thresholds.SHARP * reach_m:
        return True
    away_m = np.linspace(0.0, compared_m, _COMPARED)

    def sides(channel: Array, shift_m: float) -> Array:
        """The channel before and after the peak, less its mean, shape (2, places): a slope sensor
        may be tilted."""
        turn_m = peak_m + shift_m
        values = np.stack([
            np.interp(turn_m - away_m, driven_m, channel),
            np.interp(turn_m + away_m, driven_m, channel),
        ])  # fmt: skip
        return np.asarray(values - values.mean())

    noise_m2 = white_noise(base_m) ** 2

    def asymmetry_m2(base_sides: Array) -> float:
        """Mean squared difference of the distances on both sides, beyond that of their noise."""
        inward, outward = base_sides
        return float(np.mean((inward - outward) ** 2)) / 2.0 - noise_m2

    shifts_m = (np.linspace(-0.5, 0.5, _SHIFTS) * reach_m).tolist()
    shift_m = min(shifts_m, key=lambda shift_m: asymmetry_m2(sides(base_m, shift_m)))
    base_sides = sides(base_m, shift_m)
    is_as_far = asymmetry_m2(base_sides) <= thresholds.AS_FAR * float(np.var(base_sides))
    # Slopes that are met again reversed cancel.
    slope_sides = sides(slope, shift_m)
    not_reversed = float(np.mean((slope_sides[0] + slope_sides[1]) ** 2)) / 2.0
    return is_as_far and not_reversed <= thresholds.REVERSED * float(np.var(slope_sides))
