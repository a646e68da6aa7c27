"""What to do with files that are read by nothing here, by the endings of their names."""

from __future__ import annotations

from pathlib import Path

TRACKS = (".kml", ".kmz", ".geojson", ".tcx", ".nmea")
"""Endings of tracks in formats that are not read."""

_PACKED = {
    ".zstd": "is packed as a whole: unpack it (zstd -d FILE), or give the folder of its bag",
    ".zst": "is packed as a whole: unpack it (zstd -d FILE)",
    ".gz": "is packed: unpack it (gunzip FILE); only tables are read packed, as .csv.gz",
    ".xz": "is packed: unpack it (xz -d FILE)",
    ".bz2": "is packed: unpack it (bunzip2 FILE)",
    **dict.fromkeys(
        (".zip", ".7z", ".tar", ".tgz", ".rar"), "is packed: unpack it, and give the files in it"
    ),
}
_SPREADSHEET = "is a spreadsheet: save it as CSV"
_ROUTE = "is a track, without power; give it as a route (homeward routes FILE)"
_OTHER_TABLE = "is a table of a kind that is not read: write it as CSV or Parquet"
_NO_RECORDING = {
    ".tlog": "is a telemetry log of MAVLink: give the autopilot's own log (.bin, .ulg), or write it as a table "
    "(mavlogdump.py --format csv of pymavlink)",
    **dict.fromkeys((".xlsx", ".xls", ".ods"), _SPREADSHEET),
    **dict.fromkeys((".gpx", ".fit"), _ROUTE),
    **dict.fromkeys(TRACKS, "is a track, without power; for a route convert it to GPX, as with gpsbabel"),
    **dict.fromkeys((".json", ".jsonl", ".h5", ".hdf5", ".mat", ".feather", ".arrow"), _OTHER_TABLE),
}  # fmt: skip
_NO_ROUTE = {
    **dict.fromkeys((*TRACKS, ".json"), "is a track of another format; convert it to GPX, as with gpsbabel"),
    **dict.fromkeys((".xlsx", ".xls", ".ods"), _SPREADSHEET),
    **dict.fromkeys(
        (".bag", ".mcap", ".db3", ".ulg", ".bin", ".tlog", ".parquet"),
        "is a recording; a route is a track (.gpx, .fit) or a CSV file with distance_m",
    ),
}  # fmt: skip


def why_no_recording(path: Path) -> str | None:
    """Why a file is no recording by its ending, and what to do; None where the ending says
    nothing."""
    return _of_ending(path, _PACKED | _NO_RECORDING)


def why_no_route(path: Path) -> str | None:
    """The same of a route."""
    return _of_ending(path, _PACKED | _NO_ROUTE)


def _of_ending(path: Path, remedies: dict[str, str]) -> str | None:
    return remedies.get(path.suffix.lower())
