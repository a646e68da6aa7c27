"""Reading recordings: one file, one run, SI channels by name; anything unusable is refused with one clear line."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from homeward.diagnosis.read.bags import is_bag, sha256
from homeward.diagnosis.read.channels import CHANNELS, MOTION, Array, Channel, first_set, lacking
from homeward.diagnosis.read.columns import Columns, RecordingError, load_columns

__all__ = ["Recording", "RecordingError", "read_recording"]

_SUFFIXES = (".csv", ".csv.gz", ".txt", ".parquet")
_STRAY_SHARE = 0.01  # up to this share of impossible values is taken for glitches and left out, more for a wrong unit
_MOST_BROKEN = 0.1  # of the lines of a file without names of columns; more for a mapping of other files
_LONGEST_STEP_S = 30.0
_LONGEST_RUN_S = 3 * 86400.0
_SAME: tuple[tuple[str, str, dict[float, str]], ...] = (  # and what the ratio is where one of them is in another unit
    ("speed_mps", "distance_m", {3.6: "km/h", 2.237: "miles per hour", 100.0: "cm/s", 1000.0: "mm/s"}),
    ("speed_mps", "the wheel speeds", {3.6: "km/h", 100.0: "cm/s", 1000.0: "mm/s"}),
    ("yaw_rate_radps", "heading_rad", {57.3: "degrees per second"}),
    ("voltage_v x current_a", "power_w", {1e3: "millivolts or milliamperes", 1e6: "millivolts and milliamperes"}),
)


@dataclass(frozen=True)
class Recording:
    """One run of one robot.

    `channels` maps names of the schema to float64 arrays of shape (n,) in SI units; a value that was not recorded is
    NaN. `notes` says what reading left out.
    """

    name: str
    sha256: str
    channels: Mapping[str, Array]
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
    bag = path.exists() and is_bag(path)
    mapping = None if bag or columns is None else load_columns(columns)
    try:
        table, notes = _read_bag(path, columns) if bag else _read_table(path, mapping, standing)
        return Recording(str(path), sha256(path), _checked(table, notes), tuple(notes))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def _read_bag(path: Path, mapping: str | Path | Columns | None) -> tuple[pd.DataFrame, list[str]]:
    if isinstance(mapping, Columns):
        raise RecordingError("a bag takes a mapping of topics, not of columns")
    try:
        from homeward.diagnosis.read.bags.reading import read_bag  # only now: it needs a further package
    except ImportError:
        raise RecordingError("a bag needs rosbags; install it with pip install 'homeward[logs]'") from None
    return read_bag(path, mapping)


def _read_table(path: Path, mapping: Columns | None, standing: bool) -> tuple[pd.DataFrame, list[str]]:
    suffix = next((s for s in _SUFFIXES if path.name.lower().endswith(s)), None)
    if not path.exists():
        raise RecordingError("no such file")
    if not path.is_file():
        raise RecordingError("is a folder; give the files of the runs in it")
    if suffix is None:
        raise RecordingError(f"unknown kind of file; a recording is {', '.join(_SUFFIXES)} or a bag")
    if path.stat().st_size == 0:
        raise RecordingError("is empty")
    notes: list[str] = []
    if suffix == ".parquet":
        table = _read_parquet(path, mapping, standing)
    elif mapping is not None and mapping.header:
        table = _read_without_header(path, mapping, notes)
    else:
        table = _read_csv(path, mapping, standing)
    table = table if mapping is None else mapping.apply(table)
    if standing and not first_set(MOTION, [*map(str, table.columns)]):
        table = table.assign(speed_mps=0.0)
    return table, notes


def _opened(path: Path) -> BinaryIO:
    return cast(BinaryIO, gzip.open(path, "rb")) if path.suffix.lower() == ".gz" else path.open("rb")


def _read_without_header(path: Path, mapping: Columns, notes: list[str]) -> pd.DataFrame:
    """Columns that the mapping names, by line of the file; broken lines are left out, and a note says so."""
    wanted = _wanted(list(mapping.header), mapping)
    with _opened(path) as file:
        lines = file.read().decode("utf-8-sig", "replace").splitlines()
    rows = {number: cells for number, line in enumerate(lines)
            if len(cells := line.split(mapping.separator)) == len(mapping.header)}  # fmt: skip
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(mapping.header))[wanted]
    plain = [name for name in wanted if name != mapping.stamp]
    table[plain] = table[plain].apply(pd.to_numeric, errors="coerce")
    whole: pd.DataFrame = table[np.isfinite(table[plain].to_numpy(dtype=np.float64)).all(axis=1)]
    broken = len(lines) - len(whole)
    if broken > _MOST_BROKEN * len(lines):
        numbers = f"the {len(mapping.header)} numbers of the mapping {mapping.name}"
        raise RecordingError(f"{broken} of {len(lines)} lines do not hold {numbers}")
    if broken:
        notes.append(f"{broken} broken lines are left out")
    return whole


def _read_csv(path: Path, mapping: Columns | None, standing: bool) -> pd.DataFrame:
    separator = "," if mapping is None else mapping.separator
    try:
        with _opened(path) as file:
            line = file.readline(1 << 16).decode("utf-8-sig")
        header = [name.strip() for name in next(csv.reader([line], delimiter=separator), [])]
        wanted = _wanted(header, mapping, standing)
        places = [header.index(name) for name in wanted]
        # All columns are read as they are, so that a short last line can be told from an empty last cell.
        table = pd.read_csv(path, sep=separator, encoding="utf-8-sig", skipinitialspace=True, header=0,
                            names=range(len(header)), usecols=[*places, len(header) - 1], index_col=False,
                            low_memory=False)  # fmt: skip
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RecordingError(f"is not a whole gzip file ({error}); copy or record it again") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError("is not text but binary data; a recording is CSV or Parquet") from error
    except pd.errors.EmptyDataError as error:
        raise RecordingError("holds no samples") from error
    except pd.errors.ParserError as error:
        raise RecordingError(f"is not a table: {str(error).splitlines()[0]}") from error
    if len(table) and pd.isna(table[len(header) - 1].iloc[-1]):
        _refuse_cut_line(path, len(header), separator)
    return table[places].set_axis(wanted, axis="columns")


def _refuse_cut_line(path: Path, whole: int, separator: str) -> None:
    """A last line with fewer cells than the header is one that was still being written."""
    with _opened(path) as file:
        file.seek(max(file.seek(0, 2) - (1 << 16), 0))
        line = file.read().rstrip(b"\r\n").rsplit(b"\n", 1)[-1]
    cells = len(line.decode("utf-8", "replace").split(separator))
    if cells < whole:
        raise RecordingError(f"the last line is cut off ({cells} of {whole} cells); delete it or record again")


def _read_parquet(path: Path, mapping: Columns | None, standing: bool) -> pd.DataFrame:
    try:
        with pq.ParquetFile(path) as file:
            wanted = _wanted(file.schema_arrow.names, mapping, standing)
            table: pd.DataFrame = file.read(columns=wanted).to_pandas()[wanted]
            return table
    except (pa.ArrowException, OSError) as error:
        message = str(error).splitlines()[0]
        raise RecordingError(f"is not a whole Parquet file ({message}); copy or record it again") from error


def _wanted(header: list[str], mapping: Columns | None, standing: bool = False) -> list[str]:
    """Columns to read: those that the mapping names, or those of the schema."""
    if mapping is not None:
        missing = [name for name in mapping.file_columns() if name not in header]
        if missing:
            names = ", ".join(missing)
            raise RecordingError(f"has no column {names}, which the mapping {mapping.name} names; {_has(header)}")
        wanted = mapping.file_columns()
    else:
        wanted = [name for name in CHANNELS if name in header]
        _refuse_missing([*wanted, "speed_mps"] if standing else wanted, header)
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise RecordingError(f"has two columns {twice[0]}; keep one")
    return wanted


def _refuse_missing(present: list[str], header: list[str]) -> None:
    advice = f"{_has(header)}; name the columns in a mapping file (--columns)"
    if "time_s" not in present:
        raise RecordingError(f"has no column time_s; {advice}")
    if lacks := lacking(present):
        stood = ", or say --standing if the robot stood" if lacks.startswith("motion") else ""
        raise RecordingError(f"has no {lacks}; {advice}{stood}")


def _has(header: list[str]) -> str:
    return f"it has {', '.join(map(_shown, header[:12])) or 'none'}{', ...' if len(header) > 12 else ''}"


def _shown(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)[:30]


def _checked(table: pd.DataFrame, notes: list[str]) -> dict[str, Array]:
    """Channels of a table, with notes on what is left out."""
    if len(table) < 2:
        raise RecordingError(f"holds {len(table)} samples; at least 2 are needed")
    channels: dict[str, Array] = {}
    for channel in (CHANNELS[column] for column in table.columns):
        values = _numbers(table[channel.name])
        if channel.name == "time_s":
            _refuse_bad_time(values)
        else:
            notes += _leave_out_impossible(channel, values)
        channels[channel.name] = values
    _refuse_missing(list(channels), list(table.columns))
    _refuse_contradiction(channels)
    return channels


def _numbers(column: pd.Series[Any]) -> Array:
    if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
        numbers = pd.to_numeric(column, errors="coerce")
        bad = np.flatnonzero((numbers.isna() & column.notna()).to_numpy())
        if len(bad):
            cell = _shown(str(column.iloc[bad[0]]))
            raise RecordingError(f"{column.name} in row {bad[0] + 1} is {cell!r}, not a number")
        column = numbers
    values = column.to_numpy(dtype=np.float64, na_value=np.nan, copy=True)
    if np.isinf(values).any():
        raise RecordingError(f"{column.name} in row {int(np.argmax(np.isinf(values))) + 1} is infinite")
    return values


def _refuse_bad_time(time_s: Array) -> None:
    if np.isnan(time_s).any():
        raise RecordingError(f"time_s in row {int(np.argmax(np.isnan(time_s))) + 1} is missing")
    steps = np.diff(time_s)
    if not (steps > 0.0).all():
        row = int(np.argmax(~(steps > 0.0))) + 2
        how = "repeats" if steps[row - 2] == 0.0 else "goes back"
        raise RecordingError(
            f"time_s {how} in row {row} ({time_s[row - 1]:.6g} after {time_s[row - 2]:.6g}); "
            "sort the samples, drop repeated ones, one run a file"
        )
    step_s, duration_s = float(np.median(steps)), float(time_s[-1] - time_s[0])
    if step_s > _LONGEST_STEP_S or duration_s > _LONGEST_RUN_S or abs(time_s[0]) > CHANNELS["time_s"].high:
        units = CHANNELS["time_s"].mistaken
        # Robots are logged at about 10 Hz: the unit that comes closest is the likeliest.
        unit, factor = min(units, key=lambda u: abs(np.log(step_s * u[1] / 0.1)))
        raise RecordingError(
            f"time_s steps by {step_s:.6g} over {duration_s:.6g}; this looks like {unit}, not seconds "
            f"(factor {factor:g} in a mapping file)"
        )


def _leave_out_impossible(channel: Channel, values: Array) -> list[str]:
    """Set impossible values to NaN, with a note; many of them are a wrong unit."""
    impossible = channel.impossible(values)
    count, allowed = int(impossible.sum()), f"{channel.low:g} to {channel.high:g} {channel.unit}"
    if count > _STRAY_SHARE * len(values):
        worst = float(np.nanmax(np.abs(values)))
        at_hand = [(unit, f) for unit, f in channel.mistaken if channel.low <= worst * f <= channel.high]
        guess = f"; this looks like {at_hand[0][0]} (factor {at_hand[0][1]:.6g} in a mapping file)" if at_hand else ""
        if channel.name == "temperature_c" and np.nanmin(values) > 150.0:
            guess = "; this looks like kelvin (offset -273.15 in a mapping file)"
        raise RecordingError(f"{channel.name} reaches {worst:.6g}, outside {allowed}{guess}")
    values[impossible] = np.nan
    return [f"{count} values of {channel.name} are outside {allowed} and left out"] if count else []


def _refuse_contradiction(channels: Mapping[str, Array]) -> None:
    """Compare channels that say the same thing: their ratio gives a wrong unit away."""

    def travel(values: Array) -> float:
        return float(np.nansum(np.abs(np.diff(values))))

    given = dict(channels)
    if "wheel_left_mps" in given and "wheel_right_mps" in given:
        given["the wheel speeds"] = (given["wheel_left_mps"] + given["wheel_right_mps"]) / 2.0
    rates, steps_s = ("speed_mps", "the wheel speeds", "yaw_rate_radps"), np.diff(given["time_s"])
    amounts = {name: float(np.nansum(np.abs(given[name][:-1]) * steps_s)) for name in rates if name in given}
    if "distance_m" in given:
        amounts["distance_m"] = travel(given["distance_m"])
    if "heading_rad" in given:
        if np.nanmax(np.abs(np.diff(given["heading_rad"]))) > 180.0:
            raise RecordingError("heading_rad jumps by more than 180; this looks like degrees (factor 0.0174533)")
        if not np.isnan(given["heading_rad"]).any():
            amounts["heading_rad"] = travel(np.unwrap(given["heading_rad"]))
    if all(name in given for name in ("power_w", "voltage_v", "current_a")):
        given["voltage_v x current_a"] = given["voltage_v"] * given["current_a"]
        amounts |= {name: float(np.nanmean(np.abs(given[name]))) for name in ("power_w", "voltage_v x current_a")}
    for what, reference, units in _SAME:
        value, truth = amounts.get(what, 0.0), amounts.get(reference, 0.0)
        for factor, unit in units.items() if truth > 0.0 and value > 0.0 else ():
            if abs(np.log(value / truth / factor)) < 0.12:
                raise RecordingError(
                    f"{what} is {value / truth:.3g} times what {reference} says; this looks like {unit} "
                    f"(factor {1 / factor:.6g} in a mapping file)"
                )
