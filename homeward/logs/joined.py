"""Several tables of one run, named with a plus between them: a.csv+b.csv, as one file a topic is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from homeward.logs import thresholds
from homeward.logs.columns import Columns, RecordingError
from homeward.logs.tables import SUFFIXES
from homeward.logs.times import is_epoch

BETWEEN = "+"
"""What stands between the names of the tables of one run, and between those of their mappings."""


def tables_of_run(path: Path) -> list[Path]:
    """The tables that a name means: itself if there is such a file, or those that it joins."""
    names = str(path).split(BETWEEN)
    # A plus may stand in the name of a folder, too.
    are_tables = all(name.lower().endswith((*SUFFIXES, ".parquet")) for name in names)
    return [path] if path.exists() or not are_tables else [Path(name) for name in names]


def mapping_of_table(mapping: Columns | None, header: Sequence[str]) -> Columns | None:
    """The part of a mapping for all tables of a run that one of them has."""
    if mapping is None or mapping.header:
        return mapping
    sources = {
        channel: source
        for channel, source in mapping.sources.items()
        if {name for name, _ in source.terms} <= {*header}
    }
    return replace(mapping, sources=sources)


def join(tables: Sequence[tuple[str, pd.DataFrame]]) -> tuple[pd.DataFrame, list[str]]:
    """Rows of several tables of one run, by time, and a line on what was joined.

    Tables whose clocks both count since 1970, or that overlap, have one clock. Others are taken to start together,
    which is said.

    Args:
        tables: Names and channels of the tables; the times increase.

    Raises:
        RecordingError: Two have the same channel, or were not recorded at the same time.
    """
    (first_name, first), *others = tables
    table_of = {channel: first_name for channel in first if channel != "time_s"}  # name of the table, by channel
    joined = [first]
    parts = [_said(first_name, first)]
    clocks = []
    for name, table in others:
        for channel in (channel for channel in table if channel != "time_s"):
            if channel in table_of:
                raise RecordingError(f"{channel} is in {table_of[channel]} and in {name}; name one in a mapping file")
            table_of[channel] = name
        late_s, how = _late_s(first_name, first["time_s"], name, table["time_s"])
        clocks.append(how)
        joined.append(table.assign(time_s=table["time_s"] - late_s))
        parts.append(_said(name, table))
    rows = pd.concat(joined).groupby("time_s", as_index=False).first()
    return rows, [f"tables of one run are joined: {'; '.join(parts)}", *clocks]


def _said(name: str, table: pd.DataFrame) -> str:
    return f"{', '.join(str(channel) for channel in table if channel != 'time_s')} from {name}"


def _late_s(first_name: str, first_s: pd.Series[float], name: str, other_s: pd.Series[float]) -> tuple[float, str]:
    """Time by which the clock of another table is ahead of that of the first, s, and a line on how it is known."""
    start_s, other_start_s = float(first_s.iloc[0]), float(other_s.iloc[0])
    overlap_s = min(float(first_s.iloc[-1]), float(other_s.iloc[-1])) - max(start_s, other_start_s)
    if overlap_s > 0.0:
        return 0.0, f"times of {first_name} and {name} overlap by {overlap_s:.4g} s: assumed to be of one clock"
    if is_epoch(start_s) and is_epoch(other_start_s):
        raise RecordingError(
            f"{first_name} and {name} were not recorded at the same time: {abs(other_start_s - start_s):.6g} s lie "
            "between their starts"
        )
    durations_s = np.array([np.ptp(first_s), np.ptp(other_s)])
    if durations_s.min() < thresholds.TOGETHER_SHARE * durations_s.max():
        raise RecordingError(
            f"{first_name} lasts {durations_s[0]:.4g} s and {name} {durations_s[1]:.4g} s, on different clocks: "
            "give both times of one clock"
        )
    how = f"the clock of {name} is another: it is taken to start together with {first_name}"
    return other_start_s - start_s, how
