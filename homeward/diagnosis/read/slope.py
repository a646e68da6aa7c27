"""The slope along the way from a recorded elevation, smoothed over a distance set by the
elevation's own noise.

Elevation is smoothed over distance driven and not over time, so that standstill adds no slope. The
stiffness of the spline follows from the noise; it may bend freely where the robot turns back on its
way.
"""

from typing import NamedTuple

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.noise import smoothed
from homeward.logs.channels import Array, Index

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
        kinks: Whether the slope may change suddenly, as where the robot turns round; without, it is
            faster.
    """
    onward_m = speed_mps[:-1] * steps_s  # negative in reverse
    path_m = np.concatenate(([0.0], np.cumsum(np.abs(onward_m))))
    length_m = float(path_m[-1])
    if length_m < thresholds.FEWEST_VALUES * cell_m or not np.isfinite(elevation_m).any():
        return None
    cells = int(length_m / cell_m)
    cell_m = length_m / cells
    cell = np.minimum((path_m / cell_m).astype(np.intp), cells - 1)
    heights = _from_steps(elevation_m, path_m)
    if heights is None:
        # Weighted by distance, not time: a stop would bias the mean of its cell to where in it the
        # robot stands.
        heights = _Heights(elevation_m, np.append(np.abs(onward_m), 0.0), are_counts=False)
    if heights.are_level:
        return np.zeros(len(elevation_m)), 0.0
    cell_height_m, cell_weight = heights.means(cell, cells)
    if int((cell_weight > 0.0).sum()) < thresholds.FEWEST_VALUES:
        return None
    direction = np.sign(np.bincount(cell[:-1], onward_m, cells))
    turns_back = np.abs(np.diff(direction)) > 1.0
    breaks = np.where(turns_back[:-1] | turns_back[1:], 0.0, 1.0)
    smooth = smoothed(cell_height_m, 2, cell_weight, breaks, kinks)
    rise = np.clip(np.diff(smooth.values) / cell_m, -thresholds.STEEPEST, thresholds.STEEPEST)
    # Beside the noise: within a cell the slope may be that of the cell before or after.
    error_of_noise = np.std(np.diff(smooth.draws, axis=1)) / cell_m
    error_within_cell = np.std(np.diff(rise)) / 2.0
    edges_m = np.arange(1, cells) * cell_m
    rise_on_path: Array = np.interp(path_m, edges_m, rise)
    # In reverse the slope along forward travel has the other sign.
    rise_forward = np.where(speed_mps < 0.0, -rise_on_path, rise_on_path)
    return np.arctan(rise_forward), float(np.hypot(error_of_noise, error_within_cell))


class _Heights(NamedTuple):
    """Heights and weights of samples, shape (n,) each; a weight is a number of observations if
    `are_counts`."""

    height_m: Array
    weight: Array
    are_counts: bool

    @property
    def _known_weight(self) -> Array:
        return np.where(np.isfinite(self.height_m), self.weight, 0.0)

    @property
    def are_level(self) -> bool:
        """Whether all have the same height."""
        return not np.ptp(self.height_m[self._known_weight > 0.0])

    def means(self, cell: Index, cells: int) -> tuple[Array, Array]:
        """Mean height and number of observations of each cell, shape (cells,) each; `cell` has
        shape (n,)."""
        weight = self._known_weight
        sums: Array = np.bincount(cell, weight, cells).astype(np.float64)
        mean_m = np.bincount(cell, weight * np.nan_to_num(self.height_m), cells) / np.maximum(
            sums, 1e-12
        )
        if self.are_counts:
            return mean_m, sums
        # Effective number of observations of unequal weights (Kish, 1965).
        return mean_m, sums**2 / np.maximum(np.bincount(cell, weight**2, cells), 1e-24)


def _from_steps(elevation_m: Array, path_m: Array) -> _Heights | None:
    """Heights and weights at the steps of a coarse elevation, in the middle between two levels;
    None if it is not coarse.

    Between two steps the height is known to a step only: the middle of a plateau gets a small
    weight.
    """
    finite = np.flatnonzero(np.isfinite(elevation_m))
    moved = np.append(True, np.diff(path_m[finite]) > 0.0)
    steps = np.flatnonzero(np.diff(elevation_m[finite]) != 0.0)
    if not 0 < len(steps) < thresholds.PLATEAUS * int(moved.sum()):
        return None
    # The last sample before each step and the first after it.
    step_from = finite[steps]
    step_to = finite[steps + 1]
    plateau_end = np.append(step_from, finite[-1])
    edges_m = np.concatenate(([path_m[finite[0]]], path_m[step_to], [path_m[finite[-1]]]))
    middles_m = (edges_m[1:] + edges_m[:-1]) / 2.0
    plateau_middle = np.clip(np.searchsorted(path_m, middles_m), 0, len(path_m) - 1)
    height = np.full(len(elevation_m), np.nan)
    weight = np.zeros(len(elevation_m))
    height[plateau_middle] = elevation_m[plateau_end]
    weight[plateau_middle] = _MIDDLE
    # Afterwards: where a plateau is so short that its middle is its step, the step counts.
    height[step_to] = (elevation_m[step_from] + elevation_m[step_to]) / 2.0
    weight[step_to] = 1.0
    return _Heights(height, weight, are_counts=True)
