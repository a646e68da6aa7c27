"""Reading recordings: one file, one run, SI channels by name; anything unusable is refused with one clear line."""

from __future__ import annotations

import csv
import gzip
import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from homeward.diagnosis.read.bags.files import is_bag, sha256
from homeward.diagnosis.read.channels import CHANNELS, MOTION, POWER, Channel
from homeward.diagnosis.read.columns import Columns, RecordingError, load_columns

__all__ = ["Recording", "RecordingError", "read_recording"]

_SUFFIXES = (".csv", ".csv.gz", ".txt", ".parquet")
_STRAY_SHARE = 0.01  # up to this share of impossible values is taken for glitches and left out, more for a wrong unit
_MOST_BROKEN = 0.1  # of the lines of a file without names of columns; more for a mapping of other files
_LONGEST_STEP_S = 30.0
_LONGEST_RUN_S = 3 * 86400.0


@dataclass(frozen=True)
class Recording:
    """One run of one robot.

    `channels` maps names of the schema to float64 arrays of shape (n,) in SI units; a value that was not recorded is
    NaN. `notes` says what reading left out.
    """

    name: str
    sha256: str
    channels: Mapping[str, NDArray[np.float64]]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.channels["time_s"])

    @property
    def duration_s(self) -> float:
        """Time between the first and the last sample, s."""
        time_s = self.channels["time_s"]
        return float(time_s[-1] - time_s[0])


def read_recording(
    path: str | Path, columns: str | Path | Columns | None = None, *, standing: bool = False
) -> Recording:
    """Read a recording in the project's schema, or a foreign one through a mapping.

    Args:
        path: A .csv, .csv.gz, .txt or .parquet file, or a bag: .bag, .mcap, .db3, or the folder of a ROS 2 bag. One
            file or folder is one run.
        columns: Mapping for foreign files: shipped name, TOML path or `Columns`. For a bag it names topics, see
            `homeward.diagnosis.read.bags.topics.load_topics`, and where it is left out the one that fits best is taken.
        standing: The robot stood: a table without a motion channel gets a speed of zero instead of being refused.

    Raises:
        RecordingError: The file is missing, empty, cut off, not what its name says, lacks channels, or holds times that
            do not increase or values in another unit.
    """
    path = Path(path)
    if path.exists() and is_bag(path):
        return _read_bag(path, columns)
    notes: tuple[str, ...] = ()
    mapping = None if columns is None else load_columns(columns)
    suffix = next((s for s in _SUFFIXES if path.name.lower().endswith(s)), None)
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    if not path.is_file():
        raise RecordingError(f"{path}: is a folder; give the files of the runs in it")
    if suffix is None:
        raise RecordingError(f"{path}: unknown kind of file; a recording is {', '.join(_SUFFIXES)} or a bag")
    try:
        if path.stat().st_size == 0:
            raise RecordingError(f"{path}: is empty")
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        if mapping is not None and mapping.header and suffix != ".parquet":
            table, notes = _read_without_header(path, mapping)
        else:
            read = _read_parquet if suffix == ".parquet" else _read_csv
            table = read(path, mapping, standing)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        table = table if mapping is None else mapping.apply(table)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    if standing and not any(all(name in table for name in names) for names in MOTION):
        table = table.assign(speed_mps=0.0)
    recording = _checked(str(path), sha256, table)
    return replace(recording, notes=(*notes, *recording.notes))


def _read_bag(path: Path, mapping: str | Path | Columns | None) -> Recording:
    if isinstance(mapping, Columns):
        raise RecordingError(f"{path}: a bag takes a mapping of topics, not of columns")
    try:
        from homeward.diagnosis.read.bags.reading import read_bag  # only now: it needs a further package
    except ImportError:
        raise RecordingError(f"{path}: a bag needs rosbags; install it with pip install 'homeward[logs]'") from None
    try:
        table, notes = read_bag(path, mapping)
        digest = sha256(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    recording = _checked(str(path), digest, table)
    return replace(recording, notes=(*notes, *recording.notes))


def _read_without_header(path: Path, mapping: Columns) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Columns that the mapping names, by line of the file, and a note on the broken lines that are left out."""
    wanted = _wanted(path, list(mapping.header), mapping)
    with gzip.open(path, "rb") if path.suffix.lower() == ".gz" else path.open("rb") as file:
        lines = file.read().decode("utf-8-sig", "replace").splitlines()
    rows = {number: cells for number, line in enumerate(lines)
            if len(cells := line.split(mapping.separator)) == len(mapping.header)}  # fmt: skip
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(mapping.header))[wanted]
    plain = [name for name in wanted if not any(s.whole_seconds and s.terms[0][0] == name
                                                for s in mapping.sources.values())]  # fmt: skip
    table[plain] = table[plain].apply(pd.to_numeric, errors="coerce")
    table = table[np.isfinite(table[plain].to_numpy(dtype=np.float64)).all(axis=1)]
    broken = len(lines) - len(table)
    if broken > _MOST_BROKEN * len(lines):
        raise RecordingError(
            f"{path}: {broken} of {len(lines)} lines do not hold the {len(mapping.header)} numbers of the mapping "
            f"{mapping.name}"
        )
    return table, (f"{broken} broken lines are left out",) if broken else ()


def _read_csv(path: Path, mapping: Columns | None, standing: bool) -> pd.DataFrame:
    separator = "," if mapping is None else mapping.separator
    compression = "gzip" if path.suffix.lower() == ".gz" else None
    options: Any = {"sep": separator, "compression": compression, "encoding": "utf-8-sig", "skipinitialspace": True}
    try:
        with gzip.open(path, "rb") if compression else path.open("rb") as file:
            line = file.readline(1 << 16).decode("utf-8-sig")
        header = [name.strip() for name in next(csv.reader([line], delimiter=separator), [])]
        wanted = _wanted(path, header, mapping, standing)
        places = [header.index(name) for name in wanted]
        # All columns are read as they are, so that a short last line can be told from an empty last cell.
        table = pd.read_csv(path, **options, header=0, names=range(len(header)), usecols=[*places, len(header) - 1],
                            index_col=False, low_memory=False)  # fmt: skip
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RecordingError(f"{path}: is not a whole gzip file ({error}); copy or record it again") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: is not text but binary data; a recording is CSV or Parquet") from error
    except pd.errors.EmptyDataError as error:
        raise RecordingError(f"{path}: holds no samples") from error
    except pd.errors.ParserError as error:
        raise RecordingError(f"{path}: is not a table: {str(error).splitlines()[0]}") from error
    _refuse_cut_line(path, table, separator, compression is not None)
    chosen: pd.DataFrame = table[places].set_axis(wanted, axis="columns")
    return chosen


def _refuse_cut_line(path: Path, table: pd.DataFrame, separator: str, packed: bool) -> None:
    """A last line with fewer cells than the header is one that was still being written."""
    last = table.columns[-1]
    if len(table) == 0 or not pd.isna(table[last].iloc[-1]):
        return
    with gzip.open(path, "rb") if packed else path.open("rb") as file:
        if packed:
            *_, line = file
        else:
            file.seek(-min(path.stat().st_size, 1 << 16), 2)
            line = file.read().rstrip(b"\r\n").rsplit(b"\n", 1)[-1]
    cells = len(line.decode("utf-8", "replace").split(separator))
    if cells < int(last) + 1:
        raise RecordingError(
            f"{path}: the last line is cut off ({cells} of {int(last) + 1} cells); delete it or record again"
        )


def _read_parquet(path: Path, mapping: Columns | None, standing: bool) -> pd.DataFrame:
    try:
        with pq.ParquetFile(path) as file:
            wanted = _wanted(path, file.schema_arrow.names, mapping, standing)
            table: pd.DataFrame = file.read(columns=wanted).to_pandas()[wanted]
            return table
    except (pa.ArrowException, OSError) as error:
        message = str(error).splitlines()[0]
        raise RecordingError(f"{path}: is not a whole Parquet file ({message}); copy or record it again") from error


def _wanted(path: Path, header: list[str], mapping: Columns | None, standing: bool = False) -> list[str]:
    """Columns to read: those that the mapping names, or those of the schema."""
    if mapping is not None:
        missing = [name for name in mapping.file_columns() if name not in header]
        if missing:
            raise RecordingError(
                f"{path}: has no column {', '.join(missing)}, which the mapping {mapping.name} names; {_has(header)}"
            )
        wanted = mapping.file_columns()
    else:
        wanted = [name for name in CHANNELS if name in header]
        _refuse_missing(path, [*wanted, "speed_mps"] if standing else wanted, header)
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise RecordingError(f"{path}: has two columns {twice[0]}; keep one")
    return wanted


def _refuse_missing(path: str | Path, present: list[str], header: list[str]) -> None:
    advice = f"{_has(header)}; name the columns in a mapping file (--columns)"
    if "time_s" not in present:
        raise RecordingError(f"{path}: has no column time_s; {advice}")
    for what, sets in (("motion", MOTION), ("power", POWER)):
        if not any(all(name in present for name in names) for names in sets):
            options = " or ".join(" + ".join(names) for names in sets)
            stood = ", or say --standing if the robot stood" if what == "motion" else ""
            raise RecordingError(f"{path}: has no {what} channel ({options}); {advice}{stood}")


def _has(header: list[str]) -> str:
    shown = ", ".join("".join(c if c.isprintable() else "?" for c in name)[:30] for name in header[:12])
    return f"it has {shown or 'none'}{', ...' if len(header) > 12 else ''}"


def _checked(name: str, sha256: str, table: pd.DataFrame) -> Recording:
    if len(table) < 2:
        raise RecordingError(f"{name}: holds {len(table)} samples; at least 2 are needed")
    notes: list[str] = []
    channels: dict[str, NDArray[np.float64]] = {}
    for channel in (CHANNELS[column] for column in table.columns):
        values = _numbers(name, table[channel.name])
        if channel.name == "time_s":
            _refuse_bad_time(name, values)
        else:
            _leave_out_impossible(name, channel, values, notes)
        channels[channel.name] = values
    _refuse_missing(name, list(channels), list(table.columns))
    _refuse_contradiction(name, channels)
    return Recording(name, sha256, channels, tuple(notes))


def _numbers(name: str, column: pd.Series[Any]) -> NDArray[np.float64]:
    if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
        numbers = pd.to_numeric(column, errors="coerce")
        bad = np.flatnonzero((numbers.isna() & column.notna()).to_numpy())
        if len(bad):
            cell = "".join(c if c.isprintable() else "?" for c in str(column.iloc[bad[0]]))[:30]
            raise RecordingError(f"{name}: {column.name} in row {bad[0] + 1} is {cell!r}, not a number")
        column = numbers
    values = column.to_numpy(dtype=np.float64, na_value=np.nan, copy=True)
    if np.isinf(values).any():
        raise RecordingError(f"{name}: {column.name} in row {int(np.argmax(np.isinf(values))) + 1} is infinite")
    return values


def _refuse_bad_time(name: str, time_s: NDArray[np.float64]) -> None:
    if np.isnan(time_s).any():
        raise RecordingError(f"{name}: time_s in row {int(np.argmax(np.isnan(time_s))) + 1} is missing")
    steps = np.diff(time_s)
    if not (steps > 0.0).all():
        row = int(np.argmax(~(steps > 0.0))) + 2
        how = "repeats" if steps[row - 2] == 0.0 else "goes back"
        raise RecordingError(
            f"{name}: time_s {how} in row {row} ({time_s[row - 1]:.6g} after {time_s[row - 2]:.6g}); "
            "sort the samples, drop repeated ones, one run a file"
        )
    step_s, duration_s = float(np.median(steps)), float(time_s[-1] - time_s[0])
    if step_s > _LONGEST_STEP_S or duration_s > _LONGEST_RUN_S or abs(time_s[0]) > CHANNELS["time_s"].high:
        units = CHANNELS["time_s"].mistaken
        # Robots are logged at about 10 Hz: the unit that comes closest is the likeliest.
        unit, factor = min(units, key=lambda u: abs(np.log(step_s * u[1] / 0.1)))
        raise RecordingError(
            f"{name}: time_s steps by {step_s:.6g} over {duration_s:.6g}; this looks like {unit}, not seconds "
            f"(factor {factor:g} in a mapping file)"
        )


def _leave_out_impossible(name: str, channel: Channel, values: NDArray[np.float64], notes: list[str]) -> None:
    with np.errstate(invalid="ignore"):
        impossible = (values < channel.low) | (values > channel.high)
    count, allowed = int(impossible.sum()), f"{channel.low:g} to {channel.high:g} {channel.unit}"
    if count > _STRAY_SHARE * len(values):
        worst = float(np.nanmax(np.abs(values)))
        at_hand = [(unit, f) for unit, f in channel.mistaken if channel.low <= worst * f <= channel.high]
        guess = f"; this looks like {at_hand[0][0]} (factor {at_hand[0][1]:.6g} in a mapping file)" if at_hand else ""
        if channel.name == "temperature_c" and np.nanmin(values) > 150.0:
            guess = "; this looks like kelvin (offset -273.15 in a mapping file)"
        raise RecordingError(f"{name}: {channel.name} reaches {worst:.6g}, outside {allowed}{guess}")
    if count:
        values[impossible] = np.nan
        notes.append(f"{count} values of {channel.name} are outside {allowed} and left out")


def _refuse_contradiction(name: str, channels: Mapping[str, NDArray[np.float64]]) -> None:
    """Compare channels that say the same thing: their ratio gives a wrong unit away."""
    time_s = channels["time_s"]
    if "speed_mps" in channels and "distance_m" in channels:
        driven = _integral(np.abs(channels["speed_mps"]), time_s)
        _refuse_ratio(name, "speed_mps", driven, "distance_m", _travel(channels["distance_m"]), {
            3.6: "km/h", 2.237: "miles per hour", 100.0: "cm/s", 1000.0: "mm/s"})  # fmt: skip
    if "speed_mps" in channels and "wheel_left_mps" in channels and "wheel_right_mps" in channels:
        wheels = np.abs(channels["wheel_left_mps"] + channels["wheel_right_mps"]) / 2.0
        _refuse_ratio(name, "speed_mps", _integral(np.abs(channels["speed_mps"]), time_s), "the wheel speeds",
                      _integral(wheels, time_s), {3.6: "km/h", 100.0: "cm/s", 1000.0: "mm/s"})  # fmt: skip
    heading = channels.get("heading_rad")
    if heading is not None and np.nanmax(np.abs(np.diff(heading))) > 180.0:
        raise RecordingError(f"{name}: heading_rad jumps by more than 180; this looks like degrees (factor 0.0174533)")
    if heading is not None and "yaw_rate_radps" in channels and not np.isnan(heading).any():
        turned = _travel(np.unwrap(heading))
        _refuse_ratio(name, "yaw_rate_radps", _integral(np.abs(channels["yaw_rate_radps"]), time_s), "heading_rad",
                      turned, {57.3: "degrees per second"})  # fmt: skip
    if all(c in channels for c in ("power_w", "voltage_v", "current_a")):
        product = float(np.nanmean(np.abs(channels["voltage_v"] * channels["current_a"])))
        _refuse_ratio(name, "voltage_v x current_a", product, "power_w", float(np.nanmean(np.abs(channels["power_w"]))),
                      {1000.0: "millivolts or milliamperes", 1e6: "millivolts and milliamperes"})  # fmt: skip


def _refuse_ratio(name: str, what: str, value: float, reference: str, truth: float, units: dict[float, str]) -> None:
    if truth <= 0.0 or value <= 0.0:
        return
    for factor, unit in units.items():
        if abs(np.log(value / truth / factor)) < 0.12:
            raise RecordingError(
                f"{name}: {what} is {value / truth:.3g} times what {reference} says; this looks like {unit} "
                f"(factor {1 / factor:.6g} in a mapping file)"
            )


def _integral(values: NDArray[np.float64], time_s: NDArray[np.float64]) -> float:
    return float(np.nansum(values[:-1] * np.diff(time_s)))


def _travel(values: NDArray[np.float64]) -> float:
    return float(np.nansum(np.abs(np.diff(values))))
