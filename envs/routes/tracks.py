"""Recorded or planned tracks (GPX, FIT, positions in a CSV file) converted to elevation profiles.

A track's elevation has noise on top of hills, and differentiating it gives false slopes. The steps
from points to a profile, with the lengths below and the thresholds of
`homeward.envs.routes.thresholds`:

1. Way. Distance between positions on a sphere, summed over points at least `SPACING_M` apart.
   Nearer ones are averaged, or the jitter of a standing robot would add up. A FIT file's own
   distance is used if it has one.
2. Spikes. The elevation, linear between points on a grid of `GRID_M`, goes through a running median
   of `MEDIAN_M`.
3. Noise. A Gaussian of standard deviation `SIGMA_M` along the way, the ends continued
   point-symmetrically.
4. Turning points. Rises and falls below a threshold are removed: between the remaining turning
   points the profile is made monotonic (isotonic regression, least squares). The threshold is
   `LEAST_RISE_M` or, if larger, `NOISE_DEVIATIONS` of the noise that remains from a white error of
   the size seen in steps 2 and 3.
5. Limit. Slopes beyond `STEEPEST_OF_TRACK` are limited to it; a track with more than `CAPPED_SHARE`
   of them is refused.

Limits: hills shorter than about 100 m are flattened, and so are bridges and cuttings. GPS heights
without a barometer drift by several metres over minutes; no smoothing can distinguish that from
hills.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.routes import thresholds
from homeward.envs.routes.route import MOST_ROUTE_BYTES, RouteError, without_heights
from homeward.files import read_bytes, read_text
from homeward.installed import advice
from homeward.logs.unknown import unknown

Array = NDArray[np.float64]

GRID_M = 5.0  # of the smoothed profile; as fine as the points may be (SPACING_M)
MEDIAN_M = 50.0  # of the running median, against spikes; chosen: spikes of up to 25 m go
SIGMA_M = 25.0  # of the Gaussian, against noise; docs/results.md has the resulting ascent

_EARTH_M = 6371008.8  # mean radius, IUGG
_TO_DEGREES = 180.0 / 2**31  # FIT positions are in semicircles


@dataclass(frozen=True)
class Track:
    """Points of a track in order; arrays of shape (points,).

    Attributes:
        elevation_m: Height above any datum, m; NaN where unknown.
        latitude_deg, longitude_deg: Position, degrees, or None if only distances are known.
        distance_m: Way since the start, m, or None if it follows from the positions.
    """

    elevation_m: Array
    latitude_deg: Array | None = None
    longitude_deg: Array | None = None
    distance_m: Array | None = None


@dataclass(frozen=True)
class Profile:
    """A smoothed track on a grid; arrays of shape (n,).

    Attributes:
        distance_m: Way along the slope since the start, m.
        elevation_m: Height, m.
        heading_rad: Direction of the way, rad counter-clockwise from east, not wrapped; 0 if
            positions are unknown.
    """

    distance_m: Array
    elevation_m: Array
    heading_rad: Array

    @property
    def ascent_m(self) -> float:
        """Sum of all rises, m."""
        return float(np.clip(np.diff(self.elevation_m), 0.0, None).sum())

    def columns(self) -> dict[str, Array]:
        """The profile as the columns of a route file."""
        return {
            "distance_m": self.distance_m,
            "elevation_m": self.elevation_m,
            "heading_rad": self.heading_rad,
        }


def read_track(path: str | Path) -> Track:
    """Read the points of a GPX file (tracks, or routes if it has no track) or of the records of a
    FIT file.

    Raises:
        RouteError: The file is unreadable, of another kind or has fewer than two points, or the
            package that reads it is not installed.
    """
    path = Path(path)
    track = READERS[path.suffix.lower()](path)
    if len(track.elevation_m) < 2:
        raise RouteError(
            f"{path}: has {len(track.elevation_m)} points; give a track of at least two"
        )
    return track


def _read_gpx(path: Path) -> Track:
    try:
        import gpxpy
    except ImportError:
        raise RouteError(
            f"{path}: needs gpxpy; install it with {advice('logs', 'gpxpy')}"
        ) from None
    try:
        gpx = gpxpy.parse(read_text(path, MOST_ROUTE_BYTES))
    except (gpxpy.gpx.GPXException, ValueError, OSError) as error:
        raise RouteError(f"{path}: is not a whole GPX file: {_first_line(error)}") from None
    tables = [_table_of(segment.points) for track in gpx.tracks for segment in track.segments]
    if not any(map(len, tables)):  # planned, not recorded
        tables = [_table_of(route.points) for route in gpx.routes]
    latitude, longitude, elevation = _driven(tables, str(path)).T
    return Track(elevation, latitude, longitude)


def _table_of(points: Sequence[Any]) -> Array:
    """Latitude, longitude and elevation of the points of a GPX file, shape (points, 3)."""
    rows = [(point.latitude, point.longitude, _number(point.elevation)) for point in points]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _driven(segments: list[Array], name: str) -> Array:
    """Points of the segments of a file as one way, shape (points, 3); what was not driven is left
    out, with a warning.

    Some programs write each segment again at the start of the next. Between segments that are far
    apart nothing was recorded: the longest way without such a gap is used.
    """
    steps_seen: set[tuple[float, ...]] = set()
    is_new = [False] * len(segments)
    by_length = sorted(range(len(segments)), key=lambda number: -len(segments[number]))
    for number in by_length:
        # Steps from point to point, so that the way back over the same points is none.
        places = segments[number][:, :2]
        steps = set(map(tuple, np.hstack((places[:-1], places[1:])).tolist()))
        is_new[number] = len(places) > 1 and not steps <= steps_seen
        steps_seen |= steps
    new_segments = [segment for segment, new in zip(segments, is_new, strict=True) if new]
    repeated = sum(len(segment) > 1 for segment in segments) - len(new_segments)
    if repeated:
        warnings.warn(
            f"{name}: {repeated} segments repeat points of others: left out", stacklevel=2
        )
    lone = sum(len(segment) == 1 for segment in segments)
    if lone:
        warnings.warn(f"{name}: {lone} segments of one point: left out", stacklevel=2)
    joined: list[list[Array]] = []
    for segment in new_segments:
        near = bool(joined) and _apart_m(joined[-1][-1][-1], segment[0]) <= thresholds.SEGMENT_GAP_M
        if near:
            joined[-1].append(segment)
        else:
            joined.append([segment])
    ways = [np.concatenate(parts) for parts in joined]
    if not ways:
        return np.empty((0, 3))
    longest = max(ways, key=len)
    if len(ways) > 1:
        counts = ", ".join(str(len(way)) for way in ways)
        warnings.warn(
            f"{name}: {len(ways)} parts with gaps of more than {thresholds.SEGMENT_GAP_M:.0f} m between them "
            f"({counts} points): the longest is used; what was not recorded was not driven",
            stacklevel=2,
        )
    return longest


def _apart_m(start: Array, end: Array) -> float:
    """Distance between two points, latitude and longitude in degrees."""
    north, east = np.radians(end[:2] - start[:2])
    return _EARTH_M * float(np.hypot(north, east * np.cos(np.radians(start[0]))))


def _read_fit(path: Path) -> Track:
    try:
        import fitdecode
    except ImportError:
        raise RouteError(
            f"{path}: needs fitdecode; install it with {advice('logs', 'fitdecode')}"
        ) from None
    rows = []
    try:
        with fitdecode.FitReader(io.BytesIO(read_bytes(path, MOST_ROUTE_BYTES))) as reader:
            for frame in reader:
                if frame.frame_type == fitdecode.FIT_FRAME_DATA and frame.name == "record":
                    height = frame.get_value("enhanced_altitude", fallback=None)
                    if height is None:
                        height = frame.get_value("altitude", fallback=None)
                    latitude = frame.get_value("position_lat", fallback=None)
                    longitude = frame.get_value("position_long", fallback=None)
                    distance = frame.get_value("distance", fallback=None)
                    rows.append(
                        [_number(value) for value in (height, latitude, longitude, distance)]
                    )
    except OSError as error:
        raise RouteError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # a damaged file raises anything, from FitError to AssertionError
        raise RouteError(f"{path}: is not a whole FIT file: {_first_line(error)}") from None
    elevation_m, latitudes, longitudes, distances_m = (
        np.array(rows, dtype=np.float64).reshape(-1, 4).T
    )
    has_position = np.isfinite(latitudes) & np.isfinite(longitudes)
    has_distance = np.isfinite(distances_m)
    if has_position.sum() < 2 and has_distance.sum() < 2:
        raise RouteError(
            f"{path}: its records hold neither positions nor distances; give one that was recorded outdoors"
        )
    in_use = has_position
    way_m = None
    if has_distance.sum() >= 2:
        in_use = has_distance
        way_m = distances_m[in_use]
    if not has_position[in_use].all():
        return Track(elevation_m[in_use], distance_m=way_m)
    return Track(
        elevation_m=elevation_m[in_use],
        latitude_deg=latitudes[in_use] * _TO_DEGREES,
        longitude_deg=longitudes[in_use] * _TO_DEGREES,
        distance_m=way_m,
    )


READERS: dict[str, Callable[[Path], Track]] = {".gpx": _read_gpx, ".fit": _read_fit}
"""What reads a track, by the ending of its name."""


def profile(track: Track, name: str, slope_rad: float | None = None) -> Profile:
    """Smooth a track, see the top of this file.

    Args:
        track: Its points.
        name: Name for messages.
        slope_rad: Slope of the whole way, rad; heights are then not used.

    Raises:
        RouteError: Positions that are invalid or jump, too few elevations, a way too short for a
            grade, or slopes too steep for robots on more than a few per cent of the way.
    """
    track = _without_null_island(track, name)
    elevation = np.zeros(len(track.elevation_m))
    if slope_rad is None:
        elevation = _filled(track.elevation_m, name)
    distance, elevation, east_m, north_m = _way(track, elevation, name)
    length_m = float(distance[-1])
    if not length_m <= thresholds.LONGEST_M:
        raise RouteError(
            f"{name}: is {length_m / 1e3:.3g} km long; give a track of one drive, of at most "
            f"{thresholds.LONGEST_M / 1e3:.0f} km"
        )
    if length_m < thresholds.SHORTEST_M:
        raise RouteError(
            f"{name}: is {length_m:.0f} m long; give at least {thresholds.SHORTEST_M:.0f} m, or a CSV profile with "
            "distance_m and grade_rad for a shorter way: heights of a track are too coarse for it"
        )
    count = max(int(np.ceil(length_m / GRID_M)), 1) + 1
    grid = np.linspace(0.0, length_m, count)
    step_m = length_m / (count - 1)
    if slope_rad is not None:
        if np.isfinite(track.elevation_m).any():
            warnings.warn(
                f"{name}: its heights are not used: a slope is given for the whole way",
                stacklevel=2,
            )
        along_m = grid / np.cos(slope_rad)  # positions and distances of a track are those on a map
        return Profile(
            along_m, np.sin(slope_rad) * along_m, _heading(grid, distance, east_m, north_m)
        )
    smooth, threshold_m = _smooth(
        np.interp(grid, distance, elevation), step_m, length_m / (len(distance) - 1)
    )
    level = _without_wiggles(smooth, threshold_m)
    rise = np.diff(level)
    steep = np.abs(rise) > thresholds.STEEPEST_OF_TRACK * np.hypot(step_m, rise)
    if steep.mean() > thresholds.CAPPED_SHARE:
        steepest_deg = np.degrees(np.arcsin(thresholds.STEEPEST_OF_TRACK))
        raise RouteError(
            f"{name}: {steep.mean():.0%} of the way is steeper than {steepest_deg:.0f} degrees; no "
            "ground robot climbs that: feet, or an elevation that jumps?"
        )
    most_rise_m = step_m * np.tan(np.arcsin(thresholds.STEEPEST_OF_TRACK))
    rise = np.clip(rise, -most_rise_m, most_rise_m)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(step_m, rise))))
    height = level[0] + np.concatenate(([0.0], np.cumsum(rise)))
    return Profile(along, height, _heading(grid, distance, east_m, north_m))


def _without_null_island(track: Track, name: str) -> Track:
    """The track without points at latitude 0 and longitude 0, which receivers emit without a
    position."""
    if track.latitude_deg is None or track.longitude_deg is None:
        return track
    null = (track.latitude_deg == 0.0) & (track.longitude_deg == 0.0)
    if not null.any() or null.sum() > len(null) - 2:
        return track
    warnings.warn(
        f"{name}: {int(null.sum())} of {len(null)} points are at latitude 0, longitude 0, where a receiver has no "
        "position: left out",
        stacklevel=2,
    )
    way_m = None if track.distance_m is None else track.distance_m[~null]
    return Track(
        track.elevation_m[~null], track.latitude_deg[~null], track.longitude_deg[~null], way_m
    )


def _refuse_jump(step_m: Array, name: str) -> None:
    if len(step_m) and step_m.max() > thresholds.JUMP_M:
        raise RouteError(
            f"{name}: point {int(step_m.argmax()) + 2} is {step_m.max() / 1e3:.0f} km from the one before; "
            "remove it, or give a track of one drive"
        )


def _filled(elevation: Array, name: str) -> Array:
    # not NaN
    is_known = (np.abs(elevation) <= thresholds.MOST_ELEVATION_M) & ~unknown(
        "elevation_m", elevation
    )
    if is_known.mean() < 1.0 - thresholds.MISSING_SHARE:
        raise RouteError(
            f"{name}: {int((~is_known).sum())} of {len(is_known)} points have no elevation; {without_heights(name)}"
        )
    if not is_known.all():
        warnings.warn(
            f"{name}: {int((~is_known).sum())} of {len(is_known)} elevations are unknown or impossible: interpolated",
            stacklevel=2,
        )
    places = np.arange(len(elevation), dtype=np.float64)
    return np.interp(places, places[is_known], elevation[is_known])


def _way(
    track: Track, elevation: Array, name: str
) -> tuple[Array, Array, Array | None, Array | None]:
    """Distance, elevation and, if known, position east and north of the start, at points that are
    apart."""
    east_m = None
    north_m = None
    if track.latitude_deg is not None and track.longitude_deg is not None:
        _check_positions(track.latitude_deg, track.longitude_deg, name)
        latitude = np.radians(track.latitude_deg)
        longitude = np.unwrap(np.radians(track.longitude_deg))
        east_m = _EARTH_M * np.concatenate(
            ([0.0], np.cumsum(np.diff(longitude) * np.cos(latitude[1:])))
        )
        north_m = _EARTH_M * (latitude - latitude[0])
        _refuse_jump(np.hypot(np.diff(east_m), np.diff(north_m)), name)
    if track.distance_m is None:
        assert east_m is not None and north_m is not None
        points = _apart(east_m, north_m)
        # Each of these points represents those near it, by their mean.
        sizes = np.diff(np.append(points, len(elevation)))
        elevation = np.add.reduceat(elevation, points) / sizes
        east_m = np.add.reduceat(east_m, points) / sizes
        north_m = np.add.reduceat(north_m, points) / sizes
        steps_m = np.hypot(np.diff(east_m), np.diff(north_m))
        distance_m = np.concatenate(([0.0], np.cumsum(steps_m)))
        return distance_m, elevation, east_m, north_m
    reached_m = np.maximum.accumulate(track.distance_m)
    is_further = np.concatenate(([True], track.distance_m[1:] > reached_m[:-1]))
    points = np.flatnonzero(is_further)
    distance_m = track.distance_m[points] - track.distance_m[points[0]]
    if east_m is not None and north_m is not None:
        east_m = east_m[points]
        north_m = north_m[points]
    return distance_m, elevation[points], east_m, north_m


def _check_positions(latitude_deg: Array, longitude_deg: Array, name: str) -> None:
    wrong = np.flatnonzero(~((np.abs(latitude_deg) <= 90.0) & (np.abs(longitude_deg) <= 180.0)))
    if len(wrong):
        point = wrong[0]
        raise RouteError(
            f"{name}: point {point + 1} is at latitude {latitude_deg[point]:g}, longitude {longitude_deg[point]:g}; "
            "give degrees within 90 and 180"
        )


def _apart(east_m: Array, north_m: Array) -> NDArray[np.intp]:
    """Indices of points at least `SPACING_M` from the last one."""
    indices = [0]
    last_east_m = east_m[0]
    last_north_m = north_m[0]
    for index, (east, north) in enumerate(zip(east_m, north_m, strict=True)):
        if (east - last_east_m) ** 2 + (north - last_north_m) ** 2 >= thresholds.SPACING_M**2:
            indices.append(index)
            last_east_m = east
            last_north_m = north
    return np.array(indices, dtype=np.intp)


def _smooth(elevation: Array, step_m: float, spacing_m: float) -> tuple[Array, float]:
    """The elevation without spikes and noise, and the smallest rise, m, that remaining noise cannot
    explain."""
    from scipy.ndimage import gaussian_filter1d, median_filter

    sigma = SIGMA_M / step_m
    width = 2 * int(MEDIAN_M / step_m / 2.0) + 1
    pad = min(int(4.0 * sigma) + width, len(elevation) - 1)
    padded = np.pad(elevation, pad, mode="reflect", reflect_type="odd")
    smooth = gaussian_filter1d(median_filter(padded, width, mode="nearest"), sigma, mode="nearest")[
        pad:-pad
    ]
    removed = elevation - smooth
    noise_m = 1.4826 * float(np.median(np.abs(removed - np.median(removed))))
    # A Gaussian of deviation SIGMA_M averages 2 sqrt(pi) SIGMA_M / spacing independent errors.
    left_m = noise_m / np.sqrt(max(2.0 * np.sqrt(np.pi) * SIGMA_M / spacing_m, 1.0))
    return smooth, max(thresholds.LEAST_RISE_M, thresholds.NOISE_DEVIATIONS * left_m)


def _without_wiggles(elevation: Array, threshold_m: float) -> Array:
    """The profile made monotonic between turning points that differ by the threshold or more."""
    from scipy.optimize import isotonic_regression

    turns = _turning_points(elevation, threshold_m)
    level = elevation.copy()
    for start, end in pairwise(turns):
        part = slice(start, end + 1)
        rises = bool(elevation[end] >= elevation[start])
        level[part] = isotonic_regression(elevation[part], increasing=rises).x
    return level


def _turning_points(elevation: Array, threshold_m: float) -> list[int]:
    """Indices of the ends and of the extremes from which the profile turns back by the threshold or
    more."""
    turns = [0]
    low = 0  # index of the lowest point since the last turn
    high = 0
    may_rise = True  # at first both: it is not known yet which way it goes
    may_fall = True
    for index, height in enumerate(elevation):
        if height < elevation[low]:
            low = index
        if height > elevation[high]:
            high = index
        if may_rise and elevation[high] - height >= threshold_m:
            turns.append(high)
            low = index
            may_rise = False
            may_fall = True
        elif may_fall and height - elevation[low] >= threshold_m:
            turns.append(low)
            high = index
            may_rise = True
            may_fall = False
    return sorted({*turns, len(elevation) - 1})


def _heading(grid: Array, distance: Array, east_m: Array | None, north_m: Array | None) -> Array:
    if east_m is None or north_m is None:
        return np.zeros(len(grid))
    # Over a stretch as long as the smoothing of the heights, so that jitter makes no bends.
    behind_m = grid - SIGMA_M
    ahead_m = grid + SIGMA_M
    east = np.interp(ahead_m, distance, east_m) - np.interp(behind_m, distance, east_m)
    north = np.interp(ahead_m, distance, north_m) - np.interp(behind_m, distance, north_m)
    heading: Array = np.unwrap(np.arctan2(north, east))
    return heading


def _number(value: object) -> float:
    """A number of a file, NaN where there is none."""
    if isinstance(value, int | float):
        return float(value)
    return np.nan


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    if not lines:
        return type(error).__name__
    return lines[0]
