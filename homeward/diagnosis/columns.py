"""Mapping files: which columns of a foreign recording are which channels, with factors to SI."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from homeward.diagnosis.channels import CHANNELS


class RecordingError(ValueError):
    """A recording or mapping file that cannot be used: the message says what is wrong, where, and what to do."""


@dataclass(frozen=True)
class Source:
    """How one channel comes out of a file: the sum of `column * factor` over its columns, plus an offset."""

    terms: tuple[tuple[str, float], ...]
    offset: float = 0.0


@dataclass(frozen=True)
class Columns:
    """A mapping from the columns of a file to the channels of the schema, as a mapping file gives it."""

    name: str
    sources: dict[str, Source]
    constants: dict[str, float]
    separator: str = ","

    def file_columns(self) -> list[str]:
        """Names of the columns that are read from the file."""
        return list(dict.fromkeys(column for source in self.sources.values() for column, _ in source.terms))

    def apply(self, table: pd.DataFrame) -> pd.DataFrame:
        """Turn a table of the file's columns into one of the schema's channels."""
        channels = {}
        for channel, source in self.sources.items():
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
    lacks and that did not vary; and optionally `separator`.

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
    return files("homeward.diagnosis") / "maps"


def _parse(name: str, data: dict[str, Any]) -> Columns:
    known = {"columns", "constants", "separator", "description", "source"}
    for key in data.keys() - known:
        raise RecordingError(f"{name}: {key} is not a known entry; known: {', '.join(sorted(known))}")
    columns, constants = data.get("columns"), data.get("constants", {})
    if not isinstance(columns, dict) or not isinstance(constants, dict) or "time_s" not in columns:
        raise RecordingError(f"{name}: needs a table [columns] with at least time_s")
    for channel in (*columns, *constants):
        if channel not in CHANNELS:
            raise RecordingError(f"{name}: {channel} is not a channel; channels: {', '.join(CHANNELS)}")
    for channel, value in constants.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise RecordingError(f"{name}: constants.{channel} = {value!r} is not a number")
    sources = {channel: _source(f"{name}: columns.{channel}", entry) for channel, entry in columns.items()}
    return Columns(name, sources, {k: float(v) for k, v in constants.items()}, str(data.get("separator", ",")))


def _source(where: str, entry: Any) -> Source:
    if isinstance(entry, str):
        return Source(((entry, 1.0),))
    wanted = "write a column name, or { column = NAME, factor = NUMBER, offset = NUMBER }"
    if not isinstance(entry, dict) or entry.keys() - {"column", "columns", "factor", "factors", "offset"}:
        raise RecordingError(f"{where} = {entry!r} is not understood; {wanted}")
    names = entry.get("columns", [entry.get("column")])
    factors = entry.get("factors", [entry.get("factor", 1.0)] * len(names))
    numbers = [*factors, entry.get("offset", 0.0)]
    if not all(isinstance(column, str) for column in names) or len(names) != len(factors):
        raise RecordingError(f"{where} needs one column name and one factor each; {wanted}")
    if any(isinstance(number, bool) or not isinstance(number, int | float) for number in numbers):
        raise RecordingError(f"{where} has a factor or offset that is not a number; {wanted}")
    return Source(tuple(zip(names, map(float, factors), strict=True)), float(numbers[-1]))
