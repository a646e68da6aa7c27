"""Which way a robot drives and where on its way it is, from its distance from base and the slopes that it meets.

The distance from base has a peak where the robot turns back, and also at the far side of a loop. Where it turns back,
the distances are the same before and after, and the slopes are met again reversed; on a loop they are not. A sharp peak
is a turn without more ado.
"""

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.noise import white_noise
from homeward.logs.channels import Array

_COMPARED = 50  # places before and after a peak; chosen: half or twice as many change no test of test_way.py
_SHIFTS = 9  # places where a turn may be, around a peak of a noisy distance; chosen, 5 or 17 alike


def along_the_way(base_m: Array, driven_m: Array, slope: Array | None, reach_m: float) -> tuple[Array, Array]:
    """Direction, 1 on the way out and -1 on the way home, and place on the way, m, of each sample, shape (n,) each.

    A loop has no way home, and each of its laps begins at base.

    Args:
        base_m: Distance from base, shape (n,).
        driven_m: Distance driven, shape (n,).
        slope: Slope along forward travel, rad, shape (n,); None where it is not known well: then each peak is a turn.
        reach_m: Distance that is long against the noise of position.
    """
    driven_m = driven_m + 1e-9 * np.arange(len(driven_m))  # interpolation needs it to grow
    ahead, behind = (np.interp(driven_m + sign * reach_m, driven_m, base_m) for sign in (1.0, -1.0))
    direction = np.where(ahead < behind, -1.0, 1.0)
    place_m = base_m[0] + _passed(driven_m, direction)
    if slope is None:
        return direction, place_m
    flips = 1 + np.flatnonzero(np.diff(direction))
    # Several flips close together are one turn, or none if the direction is then as before.
    clusters = np.split(flips, 1 + np.flatnonzero(np.diff(driven_m[flips]) > reach_m))
    turns = [int(np.median(cluster)) for cluster in clusters if len(cluster) % 2]
    ends = np.array([0, *turns, len(base_m) - 1])
    for part in zip(ends[:-2], ends[1:-1], ends[2:], strict=True):
        if _turns_back(driven_m, base_m, slope, driven_m[list(part)], reach_m):
            continue
        here = part[1]
        direction[here:] *= -1.0
        begins = base_m[here] <= thresholds.CLOSED * float(np.ptp(base_m))
        place_m[here:] = (base_m[here] if begins else place_m[here]) + _passed(driven_m[here:], direction[here:])
    return direction, place_m


def _passed(driven_m: Array, direction: Array) -> Array:
    """Way along a route since the first sample, m, shape (n,)."""
    return np.concatenate(([0.0], np.cumsum(direction[:-1] * np.diff(driven_m))))


def _turns_back(driven_m: Array, base_m: Array, slope: Array, peaks_m: Array, reach_m: float) -> bool:
    """Whether the robot turns back at the second of three successive peaks; also where too little is known."""
    most_m = float(np.diff(peaks_m).min()) - reach_m / 2.0
    if most_m < 2.0 * reach_m:
        return True
    away_m = np.linspace(0.0, most_m, _COMPARED)

    def sides(channel: Array, shift_m: float) -> Array:
        """The channel before and after the peak, less its mean, shape (2, places): a slope sensor may be tilted."""
        middle_m = peaks_m[1] + shift_m
        values = np.stack([np.interp(middle_m + sign * away_m, driven_m, channel) for sign in (-1.0, 1.0)])
        return np.asarray(values - values.mean())

    beside_m = np.interp(peaks_m[1] + reach_m * np.array([-1.0, 0.0, 1.0]), driven_m, base_m)
    if 2.0 * beside_m[1] - beside_m[0] - beside_m[2] >= 2.0 * thresholds.SHARP * reach_m:
        return True
    shifts_m = np.linspace(-0.5, 0.5, _SHIFTS) * reach_m
    shifted = [sides(base_m, shift_m) for shift_m in shifts_m.tolist()]
    noise = white_noise(base_m) ** 2
    errors = [float(np.mean((before - after) ** 2)) / 2.0 - noise for before, after in shifted]
    best = int(np.argmin(errors))
    slopes = sides(slope, float(shifts_m[best]))
    as_far = errors[best] <= thresholds.AS_FAR * float(np.var(shifted[best]))
    not_mirrored = float(np.mean((slopes[0] + slopes[1]) ** 2)) / 2.0
    return as_far and not_mirrored <= thresholds.REVERSED * float(np.var(slopes))
