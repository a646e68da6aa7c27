"""The slope along the way from a recorded elevation, smoothed over a distance set by the elevation's own noise.

Elevation is smoothed over distance driven and not over time, so that standstill adds no slope. The stiffness of the
spline follows from the noise; it may bend freely where the robot turns back on its way.
"""

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.noise import smoothed
from homeward.logs.channels import Array

_MIDDLE = 0.1  # weight of the middle of a plateau over its edges: known to half a step only


def slope_along(
    elevation_m: Array, speed_mps: Array, steps_s: Array, cell_m: float, kinks: bool = True
) -> tuple[Array, float] | None:
    """Slope angle along forward travel at each sample and the standard deviation of its error, rad.

    None where the robot hardly moves or the elevation hardly steps.

    Args:
        elevation_m: Height, shape (n,), NaN where unknown.
        speed_mps: Speed, negative in reverse, shape (n,).
        steps_s: Time from each sample to the next, shape (n - 1,).
        cell_m: Samples within this distance count as taken at one place.
        kinks: Whether the slope may change suddenly, as where the robot turns round; without, it is faster.
    """
    way_m = speed_mps[:-1] * steps_s
    path_m = np.concatenate(([0.0], np.cumsum(np.abs(way_m))))
    if path_m[-1] < thresholds.FEWEST_VALUES * cell_m or not np.isfinite(elevation_m).any():
        return None
    cells = int(path_m[-1] / cell_m)
    cell_m = float(path_m[-1]) / cells
    cell = np.minimum((path_m / cell_m).astype(np.intp), cells - 1)
    # Weighted by distance, not time: a stop would bias the mean of its cell to where in it the robot stands.
    steps = _from_steps(elevation_m, path_m)
    height, weight = steps or (elevation_m, np.append(np.abs(way_m), 0.0))
    weight = np.where(np.isfinite(height), weight, 0.0)
    total: Array = np.bincount(cell, weight, cells).astype(np.float64)
    mean = np.bincount(cell, weight * np.nan_to_num(height), cells) / np.maximum(total, 1e-12)
    if steps is None:  # effective number of samples of unequal weights
        total = total**2 / np.maximum(np.bincount(cell, weight**2, cells), 1e-24)
    if not np.ptp(height[weight > 0.0]):
        return np.zeros(len(elevation_m)), 0.0
    if int((total > 0.0).sum()) < thresholds.FEWEST_VALUES:
        return None
    onward = np.bincount(cell[:-1], way_m, cells)
    turns_back = np.abs(np.diff(np.sign(onward))) > 1.0
    bends = np.where(turns_back[:-1] | turns_back[1:], 0.0, 1.0)
    found = smoothed(mean, 2, total, bends, kinks)
    rise = np.clip(np.diff(found.values) / cell_m, -thresholds.STEEPEST, thresholds.STEEPEST)
    # Beside the noise: within a cell the slope may be that of the cell before or after.
    error = float(np.hypot(np.std(np.diff(found.draws, axis=1)) / cell_m, np.std(np.diff(rise)) / 2.0))
    # In reverse the slope along forward travel has the other sign.
    steep: Array = np.interp(path_m, np.arange(1, cells) * cell_m, rise)
    return np.arctan(np.where(speed_mps < 0.0, -steep, steep)), error


def _from_steps(elevation_m: Array, path_m: Array) -> tuple[Array, Array] | None:
    """Heights and weights at the steps of a coarse elevation, in the middle between two levels; None if it is not
    coarse.

    Between two steps the height is known to a step only: the middle of a plateau gets a small weight.
    """
    known = np.flatnonzero(np.isfinite(elevation_m))
    moved = np.append(True, np.diff(path_m[known]) > 0.0)
    change = np.flatnonzero(np.diff(elevation_m[known]) != 0.0)
    if not 0 < len(change) < thresholds.PLATEAUS * int(moved.sum()):
        return None
    height, weight = np.full(len(elevation_m), np.nan), np.zeros(len(elevation_m))
    before, after = known[change], known[change + 1]
    edges = np.concatenate(([path_m[known[0]]], path_m[after], [path_m[known[-1]]]))
    middle = np.clip(np.searchsorted(path_m, (edges[1:] + edges[:-1]) / 2.0), 0, len(path_m) - 1)
    height[middle], weight[middle] = elevation_m[np.append(before, known[-1])], _MIDDLE
    height[after], weight[after] = (elevation_m[before] + elevation_m[after]) / 2.0, 1.0
    return height, weight
