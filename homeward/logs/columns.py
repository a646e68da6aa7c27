"""Mapping files: which columns of a foreign recording are which channels, with factors to SI."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from homeward.files import STANDARD_INPUT, read_toml
from homeward.logs import thresholds
from homeward.logs.channels import CHANNELS

_MAPS = files("homeward.logs") / "maps"
_ENTRIES = {
    "columns", "constants", "separator", "decimal", "header", "longer_lines", "sample_hz", "known_by_columns",
    "unknown_if_zero",
}  # fmt: skip
"""Entries of a mapping file, see `load_columns`."""


class RecordingError(ValueError):
    """A recording or mapping file that cannot be used: the message names the fault, its place, and
    a remedy."""


@dataclass(frozen=True)
class Source:
    """How one channel comes out of a file: the sum of `column * factor` over its columns, plus an
    offset."""

    terms: tuple[tuple[str, float], ...]
    offset: float = 0.0
    # numbers, and words of a table, that mean unknown beside those of all files
    unknown: tuple[float | str, ...] = ()

    def apply(self, values: Mapping[str, Any] | pd.DataFrame) -> Any:
        """The channel, of the kind that the columns are."""
        column, factor = self.terms[0]
        total = self._known(values[column]) * factor + self.offset
        for column, factor in self.terms[1:]:
            total = total + self._known(values[column]) * factor
        return total

    def _known(self, values: Any) -> Any:
        """Numbers of a column or field, NaN where they mean unknown."""
        for word in self.unknown:
            if not isinstance(word, str):
                values = values + np.where(values == word, np.nan, 0.0)
        return values


@dataclass(frozen=True)
class Columns:
    """A mapping from the columns of a file to the channels of the schema, as a mapping file gives
    it."""

    name: str
    sources: dict[str, Source]
    constants: dict[str, float]
    separator: str | None = None  # None: inferred from the file
    decimal: str | None = None  # sign in numbers; None: inferred from the file
    header: tuple[str, ...] = ()  # names of the columns of files without a line of names
    sample_hz: float | None = None  # of files without time stamps
    stamp: str | None = None  # column of time stamps that repeat within a second
    # whether a table with all of its columns is recognised without naming the mapping
    known_by_columns: bool = False
    longer_lines: bool = False  # whether more columns may follow those of the header
    unknown_if_zero: tuple[str, ...] = ()  # channels that a file lacks where they are 0 throughout

    def file_columns(self) -> list[str]:
        """Names of the columns that are read from the file."""
        columns = (column for source in self.sources.values() for column, _ in source.terms)
        return list(dict.fromkeys(columns))

    def words_for_unknown(self) -> set[str]:
        """Texts in cells that mean unknown, in lower case."""
        marks = (mark for source in self.sources.values() for mark in source.unknown)
        return {mark.lower() for mark in marks if isinstance(mark, str)}

    def time_columns(self) -> list[str]:
        """Names of the file's columns that the time comes from."""
        if "time_s" not in self.sources:
            return []
        return [column for column, _ in self.sources["time_s"].terms]

    def apply(self, table: pd.DataFrame) -> pd.DataFrame:
        """Turn a table of the file's columns, whose index counts the file's lines, into one of the
        schema's channels.

        Raises:
            RecordingError: Stamps of whole seconds that are no times, go back or span less than two
                seconds.
        """
        channels = {}
        if self.sample_hz is not None:
            channels["time_s"] = table.index.to_series() / self.sample_hz
        for channel, source in self.sources.items():
            is_stamped = channel == "time_s" and self.stamp is not None
            values = _spread(table[self.stamp]) if is_stamped else source.apply(table)
            if channel not in self.unknown_if_zero or values.any():
                channels[channel] = values
        return pd.DataFrame(channels).assign(**self.constants)


def shipped(folder: Traversable) -> list[str]:
    """Names of the mapping files in a folder of the package."""
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    )


def read_mapping(
    what: str, mapping: str | Path, folder: Traversable, entries: set[str]
) -> dict[str, Any]:
    """Content of a mapping file, by its path or the name of a shipped one in `folder`.

    Besides the entries that are `known` it may have `description` and `source`; `what` it maps is
    for messages.

    Raises:
        RecordingError: Unknown name, unreadable file or an unknown entry.
    """
    names = shipped(folder)
    path = folder / f"{mapping}.toml" if str(mapping) in names else Path(mapping)
    if not path.is_file() and str(mapping) != STANDARD_INPUT:
        raise RecordingError(
            f"{what} {str(mapping)!r} is neither a file nor a shipped mapping ({', '.join(names)})"
        )
    try:
        data = read_toml(str(path))
    except (ValueError, OSError) as error:
        raise RecordingError(f"{mapping}: not a readable TOML file: {error}") from error
    entries = entries | {"description", "source"}
    for key in sorted(data.keys() - entries):
        hint = "; for a bag, give a mapping of topics" if key == "columns" else ""
        raise RecordingError(
            f"{mapping}: {key} is not a known entry; known: {', '.join(sorted(entries))}{hint}"
        )
    return data


def _is_number(value: Any) -> bool:
    """Whether an entry is a number that a float can hold; an integer of a TOML file may have any
    length."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def source_of(where: str, entry: Any, key: str) -> Source:
    """Source by an entry of a mapping file: one name of a `key` ("column" or "field"), or a table
    of names, factors and an offset, and a list of what means unknown.

    Raises:
        RecordingError: The entry is invalid.
    """
    if isinstance(entry, str):
        return Source(((entry, 1.0),))
    wanted = f"write the name of a {key}, or {{ {key} = NAME, factor = NUMBER, offset = NUMBER }}"
    if not isinstance(entry, dict) or entry.keys() - {
        key,
        f"{key}s",
        "factor",
        "factors",
        "offset",
        "unknown",
    }:
        raise RecordingError(f"{where} = {entry!r} is not understood; {wanted}")
    names, factors = _names_and_factors(entry, key)
    if not names or len(names) != len(factors) or not all(isinstance(name, str) for name in names):
        raise RecordingError(f"{where} needs one {key} and one factor each; {wanted}")
    offset = entry.get("offset", 0.0)
    are_numbers = all(map(_is_number, [*factors, offset]))
    if not are_numbers or not all(factors):
        raise RecordingError(
            f"{where} has a factor or offset that is not a finite number, or a factor of 0; {wanted}"
        )
    marks = entry.get("unknown", [])
    if not isinstance(marks, list) or not all(
        isinstance(mark, str) or _is_number(mark) for mark in marks
    ):
        raise RecordingError(
            f"{where}.unknown = {marks!r} is not a list of numbers and words that mean unknown"
        )
    terms = tuple((name, float(factor)) for name, factor in zip(names, factors, strict=True))
    return Source(terms, float(offset), tuple(marks))


def _names_and_factors(entry: Mapping[str, Any], key: str) -> tuple[list[Any], list[Any]]:
    """Names of columns or fields of an entry, not yet checked, and their factors; [] for what is no
    list."""
    names = entry.get(f"{key}s", [entry.get(key)])
    if not isinstance(names, list):
        names = []
    factors = entry.get("factors", [entry.get("factor", 1.0)] * len(names))
    if not isinstance(factors, list):
        factors = []
    return names, factors


def load_columns(mapping: str | Path | Columns) -> Columns:
    """Load a mapping by shipped name or from a TOML file.

    The file has a table `[columns]` with one line per channel: the file's column name, or a table
    with `column` (or `columns`, which are added), `factor` (or `factors`), `offset` and `unknown`
    (a list of numbers and words that mean unknown, beside those of `homeward.logs.unknown`); a
    table `[constants]` for channels that the file lacks and that did not vary; and optionally
    `separator` and `decimal`, otherwise inferred from the file. `header`, a list of names, is for
    files without a header line: their broken lines are left out, and with `longer_lines = true`
    further columns may follow. `sample_hz` replaces missing time stamps.
    `time_s = { column = NAME, whole_seconds = true }` is for stamps of whole seconds, numbers or
    HH:MM:SS: the samples of a second are spread evenly over it. `unknown_if_zero` lists channels
    that count as missing if they are zero throughout. `known_by_columns = true` is for shipped
    mappings, see `known_columns`.

    Raises:
        RecordingError: Unknown name, unreadable file or an invalid entry.

    >>> load_columns("husky_borealtc").sources["motor_left_a"]
    Source(terms=(('curL', 1.0),), offset=0.0, unknown=())
    """
    if isinstance(mapping, Columns):
        return mapping
    name = str(mapping)
    data = read_mapping("mapping", mapping, _MAPS, _ENTRIES)
    _check_tables(name, data)
    _check_lines(name, data)
    _check_signs(name, data)
    _check_channels(name, data)
    stamp = _stamp_column(name, data["columns"])
    sources = {
        channel: source_of(f"{name}: columns.{channel}", _without_whole_seconds(entry), "column")
        for channel, entry in data["columns"].items()
    }
    _refuse_other_use_of(stamp, name, sources)
    return Columns(
        name=name,
        sources=sources,
        constants={channel: float(value) for channel, value in data.get("constants", {}).items()},
        separator=data.get("separator"),
        decimal=data.get("decimal"),
        header=tuple(data.get("header", [])),
        sample_hz=data.get("sample_hz"),
        stamp=stamp,
        known_by_columns=data.get("known_by_columns") is True,
        longer_lines=data.get("longer_lines", False),
        unknown_if_zero=tuple(data.get("unknown_if_zero", [])),
    )


def _check_tables(name: str, data: Mapping[str, Any]) -> None:
    """Refuse a mapping without a time, or whose tables are none."""
    sample_hz = data.get("sample_hz")
    if sample_hz is not None and not _is_number(sample_hz):
        raise RecordingError(f"{name}: sample_hz = {sample_hz!r} is not a finite number")
    if sample_hz is not None and not 0.0 < sample_hz < thresholds.FASTEST_SAMPLE_HZ:
        raise RecordingError(f"{name}: sample_hz = {sample_hz!r} is not between 0 and 1e6")
    are_tables = isinstance(data.get("columns"), dict) and isinstance(
        data.get("constants", {}), dict
    )
    # The time comes from a column or from the sampling rate.
    if not are_tables or ("time_s" in data["columns"]) == bool(sample_hz):
        raise RecordingError(
            f"{name}: needs a table [columns] with at least time_s, or with sample_hz instead of it"
        )


def _check_lines(name: str, data: Mapping[str, Any]) -> None:
    """Refuse entries on the lines of a file that are none: its header, longer lines and zeros."""
    header = data.get("header", [])
    is_list_of_names = isinstance(header, list) and all(
        isinstance(column, str) for column in header
    )
    if not is_list_of_names or len(set(header)) < len(header):
        raise RecordingError(f"{name}: header = {header!r} is not a list of different names")
    longer_lines = data.get("longer_lines", False)
    if longer_lines not in (False, True):
        raise RecordingError(f"{name}: longer_lines = {longer_lines!r} is neither true nor false")
    unknown_if_zero = data.get("unknown_if_zero", [])
    if not isinstance(unknown_if_zero, list) or not set(map(str, unknown_if_zero)) <= set(
        data["columns"]
    ):
        raise RecordingError(
            f"{name}: unknown_if_zero = {unknown_if_zero!r} is not a list of channels in [columns]"
        )


def _check_signs(name: str, data: Mapping[str, Any]) -> None:
    """Refuse a separator or decimal sign that is none."""
    separator = data.get("separator")
    decimal = data.get("decimal")
    is_character = isinstance(separator, str) and len(separator) == 1 and separator not in '\r\n"'
    if separator is not None and not is_character:
        raise RecordingError(f'{name}: separator = {separator!r} is not one character, such as ";"')
    if decimal not in (None, ".", ",") or (decimal is not None and decimal == separator):
        raise RecordingError(
            f'{name}: decimal = {decimal!r} is neither "." nor ",", or also separates cells'
        )


def _check_channels(name: str, data: Mapping[str, Any]) -> None:
    """Refuse channels that do not exist, and constants that are no numbers."""
    constants = data.get("constants", {})
    for channel in (*data["columns"], *constants):
        if channel not in CHANNELS:
            raise RecordingError(
                f"{name}: {channel} is not a channel; channels: {', '.join(CHANNELS)}"
            )
    for channel, value in constants.items():
        if not _is_number(value):
            raise RecordingError(f"{name}: constants.{channel} = {value!r} is not a finite number")


def _stamp_column(name: str, columns: Mapping[str, Any]) -> str | None:
    """Column of stamps of whole seconds, None if there is none.

    Raises:
        RecordingError: An entry with `whole_seconds` is invalid.
    """
    stamp = None
    for channel, entry in columns.items():
        if not isinstance(entry, dict) or "whole_seconds" not in entry:
            continue
        where = f"{name}: columns.{channel}"
        is_spread = entry["whole_seconds"]
        has_other_keys = entry.keys() != {"column", "whole_seconds"}
        if is_spread not in (False, True) or (is_spread and has_other_keys):
            raise RecordingError(
                f"{where} = {entry!r} is not understood; write {{ column = NAME, whole_seconds = true }}"
            )
        if not is_spread:
            continue
        if channel != "time_s":
            raise RecordingError(f"{name}: whole_seconds is for time_s only")
        if not isinstance(entry["column"], str):
            raise RecordingError(f"{where} = {entry!r} is not understood; column is a name")
        stamp = entry["column"]
    return stamp


def _without_whole_seconds(entry: Any) -> Any:
    if not isinstance(entry, dict):
        return entry
    return {key: value for key, value in entry.items() if key != "whole_seconds"}


def _refuse_other_use_of(stamp: str | None, name: str, sources: Mapping[str, Source]) -> None:
    """Refuse another channel from the column of the stamps."""
    for channel, source in sources.items():
        if channel != "time_s" and stamp in dict(source.terms):
            raise RecordingError(
                f"{name}: columns.{channel} is the column of the stamps, {stamp}, which holds whole seconds"
            )


def known_columns(header: Collection[str]) -> Columns | None:
    """The shipped mapping for the program that writes tables with these columns; None if there is
    none."""
    for name in shipped(_MAPS):
        mapping = load_columns(name)
        if mapping.known_by_columns and set(mapping.file_columns()) <= set(header):
            return mapping
    return None


def numeric(column: pd.Series[Any]) -> pd.Series[Any]:
    """A column as numbers, NaN where a cell is not a number.

    Raises:
        RecordingError: A number has more digits than any measured number.
    """
    try:
        return pd.to_numeric(column, errors="coerce")
    except OverflowError:
        raise RecordingError(
            "holds a whole number of hundreds of digits; is it a table of numbers?"
        ) from None


def _spread(stamps: pd.Series[Any]) -> pd.Series[Any]:
    """Times of samples whose stamps are whole seconds, s: evenly spaced from each change of the
    stamp to the next."""
    seconds = numeric(stamps)
    if seconds.isna().any():
        seconds = pd.to_timedelta(stamps.astype(str), errors="coerce").dt.total_seconds()
    if seconds.isna().any():
        stamp = str(stamps[seconds.isna()].iloc[0])[:30]
        raise RecordingError(f"the time stamp {stamp!r} is not a number or HH:MM:SS")
    stamp_s = seconds.to_numpy(dtype=np.float64, copy=True)
    is_past_midnight = np.diff(stamp_s, prepend=stamp_s[:1]) < -thresholds.HALF_A_DAY_S
    stamp_s += 86400.0 * np.cumsum(is_past_midnight)
    changes = np.flatnonzero(np.diff(stamp_s) != 0.0) + 1  # samples with which a second begins
    if len(changes) < 2 or (np.diff(stamp_s) < 0.0).any():
        raise RecordingError(
            "the time stamps go back or change less than twice, so the sampling rate is not known"
        )
    change_s = stamp_s[changes]
    step_s = float((change_s[-1] - change_s[0]) / (changes[-1] - changes[0]))
    sample = np.arange(len(stamp_s), dtype=np.float64)
    time_s = np.interp(sample, changes, change_s)
    # Before the first change and after the last one the mean rate is continued.
    time_s = np.where(sample < changes[0], change_s[0] + (sample - changes[0]) * step_s, time_s)
    time_s = np.where(sample > changes[-1], change_s[-1] + (sample - changes[-1]) * step_s, time_s)
    return pd.Series(time_s, index=stamps.index)
