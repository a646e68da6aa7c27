"""Mapping files: which columns of a foreign recording are which channels, with factors to SI."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from homeward.diagnosis.read.channels import CHANNELS


class RecordingError(ValueError):
    """A recording or mapping file that cannot be used: the message says what is wrong, where, and what to do."""


@dataclass(frozen=True)
class Source:
    """How one channel comes out of a file: the sum of `column * factor` over its columns, plus an offset."""

    terms: tuple[tuple[str, float], ...]
    offset: float = 0.0
    whole_seconds: bool = field(default=False, repr=False)  # time stamps that repeat within a second


@dataclass(frozen=True)
class Columns:
    """A mapping from the columns of a file to the channels of the schema, as a mapping file gives it."""

    name: str
    sources: dict[str, Source]
    constants: dict[str, float]
    separator: str = ","
    header: tuple[str, ...] = ()  # names of the columns of files without a line of names
    sample_hz: float | None = None  # of files without time stamps

    def file_columns(self) -> list[str]:
        """Names of the columns that are read from the file."""
        return list(dict.fromkeys(column for source in self.sources.values() for column, _ in source.terms))

    def apply(self, table: pd.DataFrame) -> pd.DataFrame:
        """Turn a table of the file's columns into one of the schema's channels.

        Args:
            table: Columns of the file; its index counts the file's lines.

        Raises:
            RecordingError: Stamps of whole seconds that are no times, go back or span less than two seconds.
        """
        channels = {}
        if self.sample_hz is not None:
            channels["time_s"] = table.index.to_series() / self.sample_hz
        for channel, source in self.sources.items():
            if source.whole_seconds:
                channels[channel] = _spread(table[source.terms[0][0]])
                continue
            total = table[source.terms[0][0]] * source.terms[0][1] + source.offset
            for column, factor in source.terms[1:]:
                total = total + table[column] * factor
            channels[channel] = total
        for channel, value in self.constants.items():
            channels[channel] = pd.Series(value, index=table.index)
        return pd.DataFrame(channels)


def shipped_columns() -> list[str]:
    """Names of the mapping files that ship with the package."""
    return sorted(p.name.removesuffix(".toml") for p in _folder().iterdir() if p.name.endswith(".toml"))


def load_columns(mapping: str | Path | Columns) -> Columns:
    """Load a mapping by shipped name or from a TOML file.

    The file has a table `[columns]` with one line per channel: the file's column name, or a table with `column` (or
    `columns`, which are added), `factor` (or `factors`) and `offset`; a table `[constants]` for channels that the file
    lacks and that did not vary; and optionally `separator`. `header`, a list of names, is for files without a line of
    names: their broken lines are left out. `sample_hz` stands for time stamps that a file lacks.
    `time_s = { column = NAME, whole_seconds = true }` is for stamps of whole seconds, numbers or HH:MM:SS: the samples
    of a second are spread evenly over it.

    Raises:
        RecordingError: Unknown name, unreadable file or a wrong entry.

    >>> load_columns("husky_borealtc").sources["motor_left_a"]
    Source(terms=(('curL', 1.0),), offset=0.0)
    """
    if isinstance(mapping, Columns):
        return mapping
    shipped = _folder() / f"{mapping}.toml"
    path = shipped if str(mapping) in shipped_columns() else Path(mapping)
    if not path.is_file():
        known = ", ".join(shipped_columns())
        raise RecordingError(
            f"mapping {str(mapping)!r} is neither a file nor one that ships with the package ({known})"
        )
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise RecordingError(f"{mapping}: not a readable TOML file: {error}") from error
    return _parse(str(mapping), data)


def _folder() -> Any:
    return files("homeward.diagnosis.read") / "maps"


def _parse(name: str, data: dict[str, Any]) -> Columns:
    known = {"columns", "constants", "separator", "header", "sample_hz", "description", "source"}
    for key in data.keys() - known:
        raise RecordingError(f"{name}: {key} is not a known entry; known: {', '.join(sorted(known))}")
    columns, constants = data.get("columns"), data.get("constants", {})
    header, sample_hz = data.get("header", []), data.get("sample_hz")
    if sample_hz is not None and (isinstance(sample_hz, bool) or not isinstance(sample_hz, int | float)):
        raise RecordingError(f"{name}: sample_hz = {sample_hz!r} is not a number")
    if sample_hz is not None and not 0.0 < sample_hz < 1e6:
        raise RecordingError(f"{name}: sample_hz = {sample_hz!r} is not between 0 and 1e6")
    if not isinstance(columns, dict) or not isinstance(constants, dict) or ("time_s" in columns) == bool(sample_hz):
        raise RecordingError(f"{name}: needs a table [columns] with at least time_s, or with sample_hz instead of it")
    if not isinstance(header, list) or not all(isinstance(one, str) for one in header) or len({*header}) < len(header):
        raise RecordingError(f"{name}: header = {header!r} is not a list of different names")
    for channel in (*columns, *constants):
        if channel not in CHANNELS:
            raise RecordingError(f"{name}: {channel} is not a channel; channels: {', '.join(CHANNELS)}")
    for channel, value in constants.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise RecordingError(f"{name}: constants.{channel} = {value!r} is not a number")
    sources = {channel: _source(f"{name}: columns.{channel}", entry) for channel, entry in columns.items()}
    if any(source.whole_seconds for channel, source in sources.items() if channel != "time_s"):
        raise RecordingError(f"{name}: whole_seconds is for time_s only")
    numbers = {k: float(v) for k, v in constants.items()}
    return Columns(name, sources, numbers, str(data.get("separator", ",")), tuple(header), sample_hz)


def _source(where: str, entry: Any) -> Source:
    if isinstance(entry, str):
        return Source(((entry, 1.0),))
    wanted = "write a column name, or { column = NAME, factor = NUMBER, offset = NUMBER }"
    if not isinstance(entry, dict) or entry.keys() - {
        "column",
        "columns",
        "factor",
        "factors",
        "offset",
        "whole_seconds",
    }:
        raise RecordingError(f"{where} = {entry!r} is not understood; {wanted}")
    names = entry.get("columns", [entry.get("column")])
    factors = entry.get("factors", [entry.get("factor", 1.0)] * len(names))
    numbers = [*factors, entry.get("offset", 0.0)]
    whole_seconds = entry.get("whole_seconds", False)
    if whole_seconds not in (False, True) or (whole_seconds and entry.keys() != {"column", "whole_seconds"}):
        raise RecordingError(f"{where} = {entry!r} is not understood; write {{ column = NAME, whole_seconds = true }}")
    if not all(isinstance(column, str) for column in names) or len(names) != len(factors):
        raise RecordingError(f"{where} needs one column name and one factor each; {wanted}")
    if any(isinstance(number, bool) or not isinstance(number, int | float) for number in numbers):
        raise RecordingError(f"{where} has a factor or offset that is not a number; {wanted}")
    return Source(tuple(zip(names, map(float, factors), strict=True)), float(numbers[-1]), whole_seconds)


def _spread(stamps: pd.Series[Any]) -> pd.Series[Any]:
    """Times of samples whose stamps are whole seconds, s: evenly spaced from each change of the stamp to the next."""
    second = pd.to_numeric(stamps, errors="coerce")
    if second.isna().any():
        second = pd.to_timedelta(stamps.astype(str), errors="coerce").dt.total_seconds()
    if second.isna().any():
        raise RecordingError(f"the time stamp {str(stamps[second.isna()].iloc[0])[:30]!r} is no number and no HH:MM:SS")
    values = second.to_numpy(dtype=np.float64, copy=True)
    values += 86400.0 * np.cumsum(np.diff(values, prepend=values[:1]) < -43200.0)  # past midnight
    first = np.flatnonzero(np.diff(values) != 0.0) + 1
    if len(first) < 2 or (np.diff(values) < 0.0).any():
        raise RecordingError("the time stamps go back or change less than twice, so the sampling rate is not known")
    index, at = np.arange(len(values), dtype=np.float64), values[first]
    step_s = float((at[-1] - at[0]) / (first[-1] - first[0]))
    time_s = np.interp(index, first, at)
    time_s = np.where(index < first[0], at[0] + (index - first[0]) * step_s, time_s)
    return pd.Series(np.where(index > first[-1], at[-1] + (index - first[-1]) * step_s, time_s), index=stamps.index)
