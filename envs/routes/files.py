"""Routes from files, CSV profiles and tracks (GPX, FIT, CSV with positions): checked, and cut into
equal places."""

from __future__ import annotations

import contextlib
import csv
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.routes import thresholds
from homeward.envs.routes.route import (
    GENERATED,
    HIDDEN_WIND,
    LIMITS,
    MOST_ROUTE_BYTES,
    WHOLE_ROUTE,
    Route,
    RouteError,
    without_heights,
)
from homeward.envs.state import MAX_PLACES
from homeward.files import STANDARD_INPUT, read_text
from homeward.remedies import why_no_route

COLUMNS = (
    "distance_m",
    "grade_rad",
    "elevation_m",
    "roughness",
    "interest",
    "heading_rad",
    "temperature_c",
    "wind_mps",
    "wind_from_rad",
)

POSITIONS = ("latitude_deg", "longitude_deg")
"""Columns that make a CSV file a track, together with `elevation_m` and nothing else."""

_ALIASES = {
    **dict.fromkeys(("lat", "latitude"), "latitude_deg"),
    **dict.fromkeys(("lon", "lng", "long", "longitude"), "longitude_deg"),
    **dict.fromkeys(("ele", "elevation", "alt", "altitude", "height"), "elevation_m"),
}
"""Names of a track's columns in files of loggers, in lower case."""


def route_names() -> list[str]:
    """Names of the shipped routes: generated ones and profiles."""
    profiles = (
        entry.name.removesuffix(".csv")
        for entry in _folder().iterdir()
        if entry.name.endswith(".csv")
    )
    return [GENERATED, HIDDEN_WIND, *sorted(profiles)]


def load_route(route: str | Path, place_m: float) -> Route:
    """Read a route from a file or by the name of a shipped one, and cut it into equal places.

    A track (a .gpx or .fit file, or a CSV file with `latitude_deg`, `longitude_deg` and
    `elevation_m`, or `lat`, `lon` and `ele`) is smoothed first, as `homeward.envs.routes.tracks`
    describes. One without heights needs a slope behind its name, `track.gpx@flat` or
    `track.gpx@grade_rad=0.02`; heights that it has are then not used. Any other CSV file is a
    profile and is used as it is.

    Columns of a profile: `distance_m` (required, increasing from 0); optionally `grade_rad` or
    `elevation_m`, `roughness`, `interest` (1 by default), `heading_rad`; and, for the whole route
    from the first row, `temperature_c`, `wind_mps`, `wind_from_rad`. Comments begin with #. If the
    header is separated by semicolons or tabs, so are the rows, and numbers may have decimal commas.
    Values are interpolated linearly; a place has their mean, and its slope from an elevation is
    that from its start to its end.

    Args:
        route: Path or name.
        place_m: Length of a place, m; shortened so that places fill the route, and lengthened if
            more than `MAX_PLACES` would be needed.

    Raises:
        RouteError: The file is unreadable, or has invalid columns or values.
    """
    path: Path | None = None
    if isinstance(route, str | Path):
        path = Path(route)
    shipped = _folder() / f"{route}.csv"
    if isinstance(route, str) and "/" not in route and shipped.is_file():
        path = shipped
    slope_rad = None
    if path is not None and not path.is_file():
        path, slope_rad = _with_slope(path)
    if path is None or not (path.is_file() or str(path) == STANDARD_INPUT):
        raise RouteError(
            f"route {str(route)!r} is neither a known route nor a file; known: {', '.join(route_names())}"
        )
    if path.suffix.lower() in (".gpx", ".fit"):
        from homeward.envs.routes import tracks  # only now: it needs further packages

        return _cut(
            path, tracks.profile(tracks.read_track(path), str(path), slope_rad).columns(), place_m
        )
    remedy = why_no_route(path)
    if remedy:
        raise RouteError(f"{path}: {remedy}")
    columns, lines = _read_table(path, heights=slope_rad is None)
    if POSITIONS[0] in columns:
        from homeward.envs.routes import tracks

        elevation_m = columns.get("elevation_m", np.full(len(lines), np.nan))
        track = tracks.Track(elevation_m, columns["latitude_deg"], columns["longitude_deg"])
        return _cut(path, tracks.profile(track, str(path), slope_rad).columns(), place_m)
    if slope_rad is not None:
        raise RouteError(
            f"{path}: is a profile, which has its slopes itself; a slope is given for a track only"
        )
    _check_profile(path, columns, lines)
    return _cut(path, columns, place_m)


def _with_slope(route: Path) -> tuple[Path, float | None]:
    """The path of a track, and the slope that is given behind its name, rad; None without one.

    Raises:
        RouteError: What is behind the name is no slope.
    """
    name, _, slope = str(route).rpartition("@")
    if not Path(name).is_file() or not name:
        return route, None
    if slope == "flat":
        return Path(name), 0.0
    steepest_rad = float(np.arcsin(thresholds.STEEPEST_OF_TRACK))
    slope_rad = np.nan
    if slope.startswith("grade_rad="):
        with contextlib.suppress(ValueError):
            slope_rad = float(slope.removeprefix("grade_rad="))
    if not abs(slope_rad) <= steepest_rad:  # not NaN either
        raise RouteError(
            f"{route}: @{slope} is no slope; say @flat, or @grade_rad=SLOPE of at most {steepest_rad:.2f} rad, "
            "positive uphill"
        )
    return Path(name), slope_rad


def _folder() -> Any:
    return files("homeward") / "routes"


def _read_table(
    path: Any, heights: bool = True
) -> tuple[dict[str, NDArray[np.float64]], list[int]]:
    """Read the columns of a CSV file by name, and the line number of each row; a track may be
    without heights."""
    try:
        text = read_text(path, MOST_ROUTE_BYTES).splitlines()
        lines = [(number, line.split("#")[0]) for number, line in enumerate(text, start=1)]
        lines = [(number, line) for number, line in lines if line.strip(" \t,;")]
        # Spreadsheets in languages with decimal commas write semicolons.
        separator = next((sign for sign in ";\t" if lines and sign in lines[0][1]), ",")
        rows = [
            (number, [field.strip() for field in next(csv.reader([line], delimiter=separator))])
            for number, line in lines
        ]
    except (ValueError, OSError, csv.Error) as error:
        raise RouteError(f"{path}: not a readable CSV table: {error}") from None
    if len(rows) < 3:
        raise RouteError(
            f"{path}: not a readable CSV table: give a header and at least two rows; a track is .gpx or .fit"
        )
    names = _as_track(rows[0][1])
    _check_names(path, names, heights)
    table = np.empty((len(names), len(rows) - 1))
    for row, (line, fields) in enumerate(rows[1:]):
        if len(fields) != len(names):
            raise RouteError(
                f"{path}: line {line}: number of fields is {len(fields)}, that of the header {len(names)}; "
                f"give a number for each of {', '.join(names)}"
            )
        for column, field in enumerate(fields):
            try:
                table[column, row] = float(field if separator == "," else field.replace(",", "."))
            except ValueError:
                table[column, row] = np.nan
            if not np.isfinite(table[column, row]):
                raise RouteError(
                    f"{path}: line {line}: {names[column]} = {field!r} is not a finite number"
                )
    return dict(zip(names, table, strict=True)), [line for line, _ in rows[1:]]


def _as_track(names: list[str]) -> list[str]:
    """Names of columns; those of a track as here, where loggers use others."""
    meant = [_ALIASES.get(name.lower(), name) for name in names]
    return meant if set(POSITIONS) <= set(meant) else names


def _check_names(path: Any, names: list[str], heights: bool) -> None:
    if any(name in POSITIONS for name in names):
        if sorted(names) == sorted(POSITIONS) and heights:
            raise RouteError(f"{path}: has no elevations; {without_heights(path)}")
        if sorted(names) not in (sorted(POSITIONS), sorted((*POSITIONS, "elevation_m"))):
            raise RouteError(
                f"{path}: a track has the columns {', '.join(POSITIONS)}, elevation_m and no others"
            )
        return
    for name in names:
        if name not in COLUMNS:
            raise RouteError(
                f"{path}: unknown column {name!r}; columns are {', '.join(COLUMNS)}, or of a track lat, lon, ele"
            )
        if names.count(name) > 1:
            raise RouteError(f"{path}: column {name} is there twice; keep one of them")
    if "distance_m" not in names:
        raise RouteError(f"{path}: no column distance_m; columns are {', '.join(COLUMNS)}")
    if "grade_rad" in names and "elevation_m" in names:
        raise RouteError(
            f"{path}: columns grade_rad and elevation_m both give the slope; keep one of them"
        )


def _check_profile(path: Any, columns: dict[str, NDArray[np.float64]], lines: list[int]) -> None:
    for name, (low, high, hint) in LIMITS.items():
        values = columns.get(name, np.empty(0))
        wrong = np.flatnonzero((values < low) | (values > high))
        if len(wrong):
            value = values[wrong[0]]
            line = lines[wrong[0]]
            raise RouteError(
                f"{path}: line {line}: {name} = {value:g} is not in [{low:g}, {high:g}] ({hint})"
            )
    distance = columns["distance_m"]
    increases = np.append(distance[0] == 0.0, np.diff(distance) > 0.0)
    if not increases.all():
        row = int(np.flatnonzero(~increases)[0])
        raise RouteError(
            f"{path}: line {lines[row]}: distance_m = {distance[row]:g}; give metres, from 0 and increasing"
        )


def _cut(path: Any, columns: dict[str, NDArray[np.float64]], place_m: float) -> Route:
    distance = columns["distance_m"]
    count = min(max(1, int(np.ceil(distance[-1] / place_m - 1e-9))), MAX_PLACES)
    edges = np.linspace(0.0, distance[-1], count + 1)
    length = edges[1]

    def mean(name: str, default: float) -> NDArray[np.float64]:
        values = columns.get(name)
        if values is None:
            return np.full(count, default)
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(distance)
        integral = np.concatenate(([0.0], np.cumsum(steps)))
        means: NDArray[np.float64] = np.diff(np.interp(edges, distance, integral)) / length
        return means

    grade = mean("grade_rad", 0.0)
    if "elevation_m" in columns:
        rise = np.diff(np.interp(edges, distance, columns["elevation_m"]))
        steepest = int(np.abs(rise).argmax())
        if abs(rise[steepest]) > thresholds.STEEPEST_SINE * length:
            raise RouteError(
                f"{path}: elevation_m changes by {rise[steepest]:g} m in {length:g} m of way, which is too steep; feet?"
            )
        grade = np.arcsin(rise / length)
    of_whole_route = {name: float(columns[name][0]) for name in WHOLE_ROUTE if name in columns}
    return Route(
        place_m=length,
        grade_rad=grade,
        roughness=mean("roughness", 0.0),
        interest=mean("interest", 1.0),
        heading_rad=mean("heading_rad", 0.0),
        **of_whole_route,
    )
