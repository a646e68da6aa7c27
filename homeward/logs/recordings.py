"""Reading recordings: one file is one run, with named channels in SI units; unusable input is
refused in one line."""

from __future__ import annotations

import hashlib
import io
import math
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from homeward.files import STANDARD_INPUT
from homeward.installed import advice
from homeward.logs import limits, tables, thresholds, unknown
from homeward.logs.bags import FLIGHT_SUFFIXES, is_bag, sha256, storage_files
from homeward.logs.channels import (
    CHANNELS,
    MOTION,
    POWER,
    Array,
    Channel,
    Mask,
    Recording,
    first_set,
    lacking,
)
from homeward.logs.columns import Columns, RecordingError, known_columns, load_columns, numeric
from homeward.logs.contradictions import refuse_contradictions
from homeward.logs.doubts import doubts
from homeward.logs.joined import BETWEEN, join, mapping_of_table, tables_of_run
from homeward.logs.plausible import leave_out_spikes
from homeward.logs.times import from_epoch, from_text
from homeward.remedies import why_no_recording

__all__ = ["Recording", "RecordingError", "read_recording"]

Mappings = str | Path | Columns | list[Columns] | None
"""Mapping of a recording, or one for each of several tables."""

_SUFFIXES = (*tables.SUFFIXES, ".parquet")
_ENOUGH = "speed_mps", "power_w"  # motion and power, which another table of the run may have
_BATCH_ROWS = 2**16  # of a Parquet file at a time; chosen: some MB of a wide table


def read_recording(
    path: str | Path, columns: Mappings = None, *, standing: bool = False
) -> Recording:
    """Read a recording in the project's schema, or another one through a mapping.

    Args:
        path: A .csv, .csv.gz, .tsv, .txt or .parquet file, a bag (.bag, .mcap, .db3, or the folder
            of a ROS 2 bag) or a log of an autopilot (.ulg, .bin). One file or folder is one run.
            "-" is standard input. Several tables of one run are named with a plus between them,
            a.csv+b.csv.
        columns: Mapping for other files: shipped name, TOML path or `Columns`. For a bag or log it
            names topics, see `homeward.logs.bags.topics.load_topics`; by default the shipped one
            that fits best. A table written by VESC Tool needs none. Of several tables each uses
            what it has of one mapping, or its own of a.toml+b.toml or of a list of `Columns`.
        standing: The robot stood: a table without a motion channel gets a speed of zero instead of
            being refused.

    Raises:
        RecordingError: The file is missing, empty, cut off or of another kind, lacks channels, or
            has times that do not increase or values in another unit.
    """
    path = Path(path)
    if str(path) == STANDARD_INPUT:
        return _read_standard_input(columns, standing)
    parts = tables_of_run(path)
    if len(parts) > 1:
        return read_tables(parts, columns, standing=standing)
    if isinstance(columns, list):
        raise RecordingError(f"{path}: is one table, and {len(columns)} mappings are given")
    is_log = path.exists() and is_bag(path)
    mapping = None if is_log or columns is None else load_columns(columns)
    try:
        start_s = 0.0
        if is_log:
            table, notes, start_s = _read_bag(path, columns)
        else:
            table, notes = _read_table(path, mapping, standing)
        digest = sha256(path)
        channels = _checked(table, notes)
        return Recording(_name(path), digest, channels, tuple(notes), start_s)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def _name(path: Path) -> str:
    """The name of a file; one that is no UTF-8 can be opened and not written."""
    return os.fsencode(path).decode("utf-8", "replace")


def read_tables(
    paths: Sequence[Path], columns: Mappings = None, *, standing: bool = False
) -> Recording:
    """Like `read_recording`, for several tables of one run.

    Raises:
        RecordingError: As of `read_recording`, or two have the same channel or were not recorded at
            the same time.
    """
    parts = []
    notes: list[str] = []
    for path, mapping in zip(paths, _mapping_of_each(paths, columns), strict=True):
        try:
            table, notes_of_part = _read_part(path, mapping)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from error
        parts.append((path.name, table))
        notes += [f"{path.name}: {note}" for note in notes_of_part]
    name = BETWEEN.join([_name(paths[0]), *(path.name for path in paths[1:])])
    try:
        rows, notes_of_join = join(parts)
        notes += notes_of_join
        rows = _with_motion(rows, standing)
        digest = hashlib.sha256("".join(map(sha256, paths)).encode()).hexdigest()
        channels = _checked(rows, notes, is_joined=True)
        return Recording(name, digest, channels, tuple(notes))
    except RecordingError as error:
        raise RecordingError(f"{name}: {error}") from error


def _mapping_of_each(
    paths: Sequence[Path], columns: Mappings
) -> Sequence[str | Path | Columns | None]:
    """The mapping of each of several tables.

    Raises:
        RecordingError: There are more or fewer mappings than tables.
    """
    mappings: Sequence[str | Path | Columns | None]
    if isinstance(columns, list):
        mappings = columns
    elif isinstance(columns, str | Path) and BETWEEN in str(columns) and not Path(columns).exists():
        mappings = str(columns).split(BETWEEN)
    else:
        mappings = [columns] * len(paths)
    if len(mappings) != len(paths):
        raise RecordingError(
            f"{len(paths)} tables are joined by {len(mappings)} mappings; give one, or one each"
        )
    return mappings


def _read_part(path: Path, columns: str | Path | Columns | None) -> tuple[pd.DataFrame, list[str]]:
    """One of several tables of a run, its time in s and increasing, and notes."""
    if path.exists() and is_bag(path):
        raise RecordingError("is a bag or log, which is a run by itself; only tables are joined")
    mapping = None if columns is None else load_columns(columns)
    table, notes = _read_table(path, mapping, standing=False, part=True)
    _refuse_few(table)
    time_s = _in_seconds(_finite(table["time_s"]), notes)
    _refuse_bad_time(time_s)
    return table.assign(time_s=time_s), notes


def _in_seconds(times: Array, notes: list[str]) -> Array:
    """Times in s; a note says which unit a count since 1970 is taken for."""
    time_s, unit = from_epoch(times)
    if unit:
        notes.append(f"time_s is in {unit}, read as s since 1970")
    return time_s


def _read_standard_input(columns: Mappings, standing: bool) -> Recording:
    """Like `read_recording`, for a table from standard input: CSV, gzipped or not, or Parquet."""
    with tempfile.TemporaryDirectory() as folder:
        start = sys.stdin.buffer.read(4)
        path = Path(folder) / f"standard_input{_suffix_of(start)}"
        with path.open("wb") as file:
            file.write(start)
            while piece := sys.stdin.buffer.read(2**20):
                if file.tell() > limits.MOST_BYTES:
                    raise RecordingError(
                        f"standard input: holds more than {limits.MOST_BYTES / 1e9:.2g} GB"
                    )
                file.write(piece)
        try:
            return replace(read_recording(path, columns, standing=standing), name="standard input")
        except RecordingError as error:
            raise RecordingError(str(error).replace(str(path), "standard input")) from None


def _suffix_of(start: bytes) -> str:
    """Ending of a table's name by its first bytes."""
    if start == b"PAR1":
        return ".parquet"
    if start.startswith(b"\x1f\x8b"):
        return ".csv.gz"
    return ".csv"


def _read_bag(
    path: Path, mapping: str | Path | Columns | None
) -> tuple[pd.DataFrame, list[str], float]:
    not_files = [file.name for file in storage_files(path) if not file.is_file()]
    if not_files:
        which = f"{not_files[0]} is" if path.is_dir() else "is"
        raise RecordingError(f"{which} a pipe or device; a bag is a file")
    if isinstance(mapping, Columns):
        raise RecordingError("a bag takes a mapping of topics, not of columns")
    try:
        from homeward.logs.bags.assemble import read_bag  # here, as it needs a further package
    except ImportError:
        raise RecordingError(
            f"a bag needs rosbags; install it with {advice('logs', 'rosbags')}"
        ) from None
    return read_bag(path, mapping)


def _read_table(
    path: Path, mapping: Columns | None, standing: bool, *, part: bool = False
) -> tuple[pd.DataFrame, list[str]]:
    """Channels of a table, of which only the time is needed where it is a part of a run, and
    notes."""
    suffix = next((suffix for suffix in _SUFFIXES if path.name.lower().endswith(suffix)), None)
    if not path.exists():
        raise RecordingError("no such file")
    if path.is_dir():
        raise RecordingError("is a folder; give the files of the runs in it")
    if not path.is_file():
        raise RecordingError("is a pipe or device; give a file, or - for standard input")
    if suffix is None:
        unknown_kind = f"unknown kind of file; a recording is {', '.join((*_SUFFIXES, *FLIGHT_SUFFIXES))} or a bag"
        raise RecordingError(why_no_recording(path) or unknown_kind)
    if path.stat().st_size == 0:
        raise RecordingError("is empty")
    notes: list[str] = []
    if suffix == ".parquet":
        table = _read_parquet(path, mapping, standing, notes, part)
    elif mapping is not None and mapping.header:
        table = _read_without_header(path, mapping, notes)
    else:
        table = _read_csv(path, mapping, standing, notes, part)
    return _with_motion(table, standing), notes


def _with_motion(table: pd.DataFrame, standing: bool) -> pd.DataFrame:
    """The table, with a speed of zero if its robot stood and it has no motion."""
    moves = first_set(MOTION, [*map(str, table.columns)])
    return table.assign(speed_mps=0.0) if standing and not moves else table


def _read_without_header(path: Path, mapping: Columns, notes: list[str]) -> pd.DataFrame:
    """Columns that the mapping names, by line of the file; broken lines are left out, and a note
    says so."""
    wanted = _wanted(list(mapping.header), mapping)
    places = {name: mapping.header.index(name) for name in wanted}
    columns: dict[str, list[Any]] = {name: [] for name in wanted}
    numbers: list[int] = []
    broken = 0
    with tables.refusing(), tables.opened(path) as file:
        for number, line in enumerate(io.TextIOWrapper(file, "utf-8-sig", "replace")):
            if number >= limits.MOST_ROWS:
                raise RecordingError(
                    f"has more than {limits.MOST_ROWS} lines; cut it into several runs"
                )
            values = _values(line, mapping, places)
            if values is None:
                broken += 1
                continue
            numbers.append(number)
            for name, value in zip(wanted, values, strict=True):
                columns[name].append(value)
    count = broken + len(numbers)
    if broken > thresholds.MOST_BROKEN_SHARE * count:
        expected = f"the {len(mapping.header)} numbers of the mapping {mapping.name}"
        raise RecordingError(f"{broken} of {count} lines do not hold {expected}")
    if broken:
        notes.append(f"{broken} broken lines are left out")
    return mapping.apply(pd.DataFrame(columns, index=numbers))


def _values(line: str, mapping: Columns, places: Mapping[str, int]) -> list[float | str] | None:
    """The wanted cells of a line as numbers, that of the stamp as it is; None where the line is
    broken."""
    cells = line.rstrip("\r\n").split(mapping.separator or ",")
    width = len(mapping.header)
    if len(cells) < width or (len(cells) > width and not mapping.longer_lines):
        return None
    values: list[float | str] = []
    for name, place in places.items():
        cell = cells[place]
        if name == mapping.stamp:
            values.append(cell)
            continue
        try:
            value = float(cell)
        except ValueError:
            return None
        if not math.isfinite(value):
            return None
        values.append(value)
    return values


def _read_csv(
    path: Path, mapping: Columns | None, standing: bool, notes: list[str], part: bool
) -> pd.DataFrame:
    if mapping is None:
        table = tables.sniff(path)
        mapping = known_columns(table.header)
        if mapping is not None:
            notes.append(f"mapping {mapping.name}, known by the names of the columns")
    else:
        table = tables.sniff(path, mapping.separator, mapping.decimal)
    mapping = mapping_of_table(mapping, table.header) if part else mapping
    wanted = _wanted(table.header, mapping, standing, part)
    dated: list[str] = []
    words: Counter[str] = Counter()
    pieces = [_in_numbers(piece, mapping, dated, words) for piece in table.pieces(wanted)]
    notes += _said_unknown(words)
    read_with = (*table.notes, *dict.fromkeys(dated))
    if read_with:
        notes.append(f"read with {', '.join(read_with)}")
    return _joined(pieces, wanted, mapping)


def _read_parquet(
    path: Path, mapping: Columns | None, standing: bool, notes: list[str], part: bool
) -> pd.DataFrame:
    dated: list[str] = []
    words: Counter[str] = Counter()
    with tables.opened_parquet(path) as file:
        mapping = mapping_of_table(mapping, file.schema_arrow.names) if part else mapping
        wanted = _wanted(file.schema_arrow.names, mapping, standing, part)
        if file.metadata.num_rows > limits.MOST_ROWS:
            raise RecordingError(f"has more than {limits.MOST_ROWS} rows; cut it into several runs")
        pieces = [_in_numbers(piece, mapping, dated, words) for piece in _batches(file, wanted)]
    notes += _said_unknown(words)
    notes += [f"read with {how}" for how in dict.fromkeys(dated)]
    return _joined(pieces, wanted, mapping)


def _joined(
    pieces: Sequence[pd.DataFrame], wanted: list[str], mapping: Columns | None
) -> pd.DataFrame:
    """Pieces of a table as one, of channels where there is a mapping."""
    table = pd.concat(pieces) if pieces else pd.DataFrame(columns=wanted, dtype=np.float64)
    return table if mapping is None else mapping.apply(table)


def _batches(file: Any, wanted: Sequence[str]) -> Iterator[pd.DataFrame]:
    """Some columns, piece by piece; the index counts the rows."""
    rows = 0
    size_bytes = 0
    # The size of columns in the metadata is not read: where it is damaged, Arrow ends the process.
    for batch in file.iter_batches(_BATCH_ROWS, columns=list(wanted)):
        size_bytes += batch.nbytes
        if size_bytes > limits.MOST_BYTES or rows > limits.MOST_ROWS:
            raise RecordingError(
                f"holds more than {limits.MOST_BYTES / 1e9:.2g} GB or {limits.MOST_ROWS} rows, unpacked; "
                "cut it into several runs"
            )
        piece = tables.in_pandas(batch)[list(wanted)]
        yield piece.set_axis(range(rows, rows + len(piece)), axis="index")
        rows += len(piece)


def _in_numbers(
    table: pd.DataFrame, mapping: Columns | None, dated: list[str], notes: Counter[str]
) -> pd.DataFrame:
    """The columns as float64; dates in the columns of the time become seconds, and `dated` says so;
    words that mean unknown are missing, and `notes` counts them."""
    words: Collection[str] = unknown.WORDS
    stamp = None
    times = ["time_s"]
    if mapping is not None:
        words = unknown.WORDS | mapping.words_for_unknown()
        stamp = mapping.stamp
        times = mapping.time_columns()
    columns: dict[str, Any] = {}
    for name in table.columns:
        if name == stamp:
            columns[name] = table[name]
        elif name in times:
            columns[name] = _times(table[name], dated)
        else:
            columns[name] = _numbers(_without_words(table[name], words, notes))
    return pd.DataFrame(columns, index=table.index)


def _times(column: pd.Series[Any], dated: list[str]) -> Array:
    """A column of times as float64; `dated` says what texts are taken for."""
    read = from_text(column)
    if read is None:
        return _numbers(column, "neither a number nor a time such as 2024-05-01T12:00:00.1")
    seconds, taken_for = read
    dated.append(taken_for)
    return _numbers(seconds)


def _without_words(
    column: pd.Series[Any], words: Collection[str], count: Counter[str]
) -> pd.Series[Any]:
    """A column without the texts that mean unknown, which are counted."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    texts = column.where(column.notna(), "").astype(str).str.strip()
    unknown_texts = texts[texts.str.lower().isin(words)]
    if unknown_texts.empty:
        return column
    for word, times in unknown_texts.value_counts().items():
        count[f"{column.name!s} is {_shown(str(word))!r}"] += int(times)
    return column.mask(texts.index.isin(unknown_texts.index))


def _said_unknown(count: Counter[str]) -> list[str]:
    return [f"{times} times {what}, which means unknown: left out" for what, times in count.items()]


def _wanted(
    header: list[str], mapping: Columns | None, standing: bool = False, part: bool = False
) -> list[str]:
    """Columns to read: those that the mapping names, or those of the schema; of a part of a run the
    time is enough.

    Raises:
        RecordingError: The table lacks one, or has it twice.
    """
    wanted = (
        _wanted_by_schema(header, standing, part)
        if mapping is None
        else _wanted_by_mapping(header, mapping)
    )
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise RecordingError(f"has two columns {twice[0]}; keep one")
    return wanted


def _wanted_by_mapping(header: list[str], mapping: Columns) -> list[str]:
    wanted = mapping.file_columns()
    missing = [name for name in wanted if name not in header]
    if missing:
        names = ", ".join(missing)
        raise RecordingError(
            f"has no column {names}, which the mapping {mapping.name} names; {_has(header)}"
        )
    return wanted


def _wanted_by_schema(header: list[str], standing: bool, part: bool) -> list[str]:
    wanted = [name for name in CHANNELS if name in header]
    if "time_s" not in header:
        _refuse_nameless(header)
    offer = f"{_has(header)}; `homeward columns RUN` proposes a mapping file (--columns) that says which is which"
    not_needed: tuple[str, ...] = ()
    if part:
        not_needed = _ENOUGH
    elif standing:
        not_needed = ("speed_mps",)
    _refuse_missing([*wanted, *not_needed], offer)
    return wanted


def _refuse_nameless(header: list[str]) -> None:
    """Refuse a table whose first line holds numbers where names should be."""
    numbers = sum(_is_number(name) for name in header)
    if numbers > thresholds.TOGETHER_SHARE * len(header):
        raise RecordingError(
            f"has no line of names (the first is {', '.join(map(_shown, header[:6]))}, ...): give a mapping with a "
            "header (--columns); those of `ros2 topic echo --csv` are ros2_echo_odometry and ros2_echo_battery"
        )


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _refuse_missing(present: list[str], advice: str) -> None:
    if "time_s" not in present:
        raise RecordingError(f"has no column time_s; {advice}")
    lacks = lacking(present)
    if lacks is not None:
        stood = "; say --standing if the robot stood" if lacks.startswith("motion") else ""
        raise RecordingError(
            f"has no {lacks}; {advice}; if another table of the run has it, give RUN{BETWEEN}OTHER{stood}"
        )


def _has(header: list[str]) -> str:
    """The columns of a table in words, as far as they fit into a line."""
    names = [_shown(name) for name in header[:12]]
    if len(header) > 12:
        names.append("...")
    return f"it has {', '.join(names) or 'none'}"


def _shown(text: str) -> str:
    """The beginning of a text of a file, without what a terminal would not print."""
    return "".join(character if character.isprintable() else "?" for character in text)[:30]


def _refuse_few(table: pd.DataFrame) -> None:
    if len(table) < 2:
        raise RecordingError(f"holds {len(table)} samples; at least 2 are needed")


def _checked(table: pd.DataFrame, notes: list[str], *, is_joined: bool = False) -> dict[str, Array]:
    """Channels of a table, with notes on what is left out."""
    _refuse_few(table)
    if "time_s" not in table.columns:
        raise RecordingError(
            f"has no time_s; the mapping gives {', '.join(table.columns) or 'nothing'}"
        )
    channels: dict[str, Array] = {}
    for name in table.columns:
        values = _finite(table[name])
        if name == "time_s":
            values = _in_seconds(values, notes)
        else:
            notes += unknown.left_out(name, values)
            notes += _leave_out_impossible(CHANNELS[name], values)
        channels[name] = values
    channels = _aligned(channels, notes, is_joined)
    _refuse_bad_time(channels["time_s"])
    notes += leave_out_spikes(channels)
    _refuse_missing(list(channels), f"it gives {', '.join(channels)}")
    notes += refuse_contradictions(channels)
    notes += doubts(channels).values()
    return channels


def _aligned(channels: dict[str, Array], notes: list[str], is_joined: bool) -> dict[str, Array]:
    """A table whose power and motion stand in different rows, as those of PlotJuggler and Foxglove,
    on one clock, which is chosen as for bags; other tables as they are."""
    needed = [*first_set(MOTION, channels), *first_set(POWER, channels)]
    time_s = channels.get("time_s", np.empty(0))
    is_in_order = np.isfinite(time_s).all() and (np.diff(time_s) >= 0.0).all()
    if (
        not needed
        or not is_in_order
        or _stand_together([channels[name] for name in needed], is_joined)
    ):
        return channels
    # only now, as it needs a part of SciPy that takes a while to load
    from homeward.logs.bags import clock

    series = {
        name: clock.in_order(time_s, values)
        for name, values in channels.items()
        if name != "time_s"
    }
    ticks = clock.slower(*(series[name][0] for name in needed))
    if len(ticks) < 2:
        raise RecordingError("power and motion were not recorded at the same time")
    notes.append(
        "power and motion stand in different rows: faster columns are averaged at the times of the slower"
    )
    aligned = {"time_s": ticks}
    for name, (known_s, values) in series.items():
        aligned[name] = clock.on_clock(known_s, values, ticks)
    return aligned


def _stand_together(channels: Sequence[Array], is_joined: bool) -> bool:
    """Whether most rows with one of the channels have all of them, or one is not known at all.

    Of tables that are joined the slower one is sparse among the rows of the faster, also where it
    shares its times: all rows count.
    """
    is_known = np.isfinite(np.array(channels))  # (channels, rows)
    fewest = int(is_known.sum(axis=1).min())
    rows = is_known.shape[1] if is_joined else fewest
    complete_rows = int(is_known.all(axis=0).sum())
    return fewest < 2 or complete_rows >= thresholds.TOGETHER_SHARE * rows


def _numbers(column: pd.Series[Any], wrong: str = "not a number") -> Array:
    """A column as float64, NaN where a cell is empty."""
    if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
        numbers = numeric(column)
        wrong_places = np.flatnonzero((numbers.isna() & column.notna()).to_numpy())
        if len(wrong_places):
            cell = _shown(str(column.iloc[wrong_places[0]]))
            row = int(column.index[wrong_places[0]]) + 1
            raise RecordingError(f"{_shown(str(column.name))} in row {row} is {cell!r}, {wrong}")
        column = numbers
    values: Array = column.to_numpy(dtype=np.float64, na_value=np.nan, copy=True)
    return values


def _finite(column: pd.Series[Any]) -> Array:
    values = _numbers(column)
    if np.isinf(values).any():
        raise RecordingError(
            f"{column.name} in row {int(np.argmax(np.isinf(values))) + 1} is infinite"
        )
    return values


def _refuse_bad_time(time_s: Array) -> None:
    if np.isnan(time_s).any():
        raise RecordingError(f"time_s in row {int(np.argmax(np.isnan(time_s))) + 1} is missing")
    steps_s = np.diff(time_s)
    increases = steps_s > 0.0
    if not increases.all():
        row = int(np.argmin(increases)) + 2
        how = "repeats" if steps_s[row - 2] == 0.0 else "goes back"
        raise RecordingError(
            f"time_s {how} in row {row} ({time_s[row - 1]:.6g} after {time_s[row - 2]:.6g}); "
            "sort the samples, drop repeated ones, one run a file"
        )
    step_s = float(np.median(steps_s))
    duration_s = float(time_s[-1] - time_s[0])
    if (
        step_s > thresholds.LONGEST_STEP_S
        or duration_s > thresholds.LONGEST_RUN_S
        or abs(time_s[0]) > CHANNELS["time_s"].high
    ):
        unit, factor = _likeliest_unit(step_s)
        raise RecordingError(
            f"time_s steps by {step_s:.6g} over {duration_s:.6g}; this looks like {unit}, not seconds "
            f"(factor {factor:g} in a mapping file)"
        )


def _likeliest_unit(step: float) -> tuple[str, float]:
    """Name and factor of the unit in which a time step is nearest to a typical one."""

    def distance(unit: tuple[str, float]) -> float:
        return float(abs(np.log(step * unit[1] / thresholds.TYPICAL_STEP_S)))

    return min(CHANNELS["time_s"].mistaken, key=distance)


def _leave_out_impossible(channel: Channel, values: Array) -> list[str]:
    """Set impossible values to NaN, with a note; many of those that are not 0 are a wrong unit."""
    impossible = channel.impossible(values)
    count = int(impossible.sum())
    if not count:
        return []
    allowed = f"{channel.low:g} to {channel.high:g} {channel.unit}"
    is_measured = np.isfinite(values) & (values != 0.0)
    is_stray = count <= thresholds.STRAY_SHARE * len(values)
    if not is_stray and impossible[is_measured].mean() > thresholds.MOST_BROKEN_SHARE:
        largest = float(np.abs(values[impossible]).max())
        hint = _hint_of_unit(channel, values, impossible)
        raise RecordingError(f"{channel.name} reaches {largest:.6g}, outside {allowed}{hint}")
    values[impossible] = np.nan
    return [f"{count} of {len(values)} values of {channel.name} are outside {allowed} and left out"]


def _hint_of_unit(channel: Channel, values: Array, impossible: Mask) -> str:
    """What a mapping file would say if the values are of a likely wrong unit; "" where none
    fits."""
    if channel.name == "temperature_c" and np.nanmin(values) > thresholds.COLDEST_K:
        return "; this looks like kelvin (offset -273.15 in a mapping file)"
    typical = float(np.median(np.abs(values[impossible])))
    for unit, factor in channel.mistaken:
        if channel.low <= typical * factor <= channel.high:
            return f"; this looks like {unit} (factor {factor:.6g} in a mapping file)"
    return ""
