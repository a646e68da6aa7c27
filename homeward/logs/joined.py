"""Several tables of one run, named with a plus between them: a.csv+b.csv, as one file a topic is
written."""

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
    if path.exists() or not are_tables:
        return [path]
    return [Path(name) for name in names]


def mapping_of_table(mapping: Columns | None, header: Sequence[str]) -> Columns | None:
    """The part of a mapping for all tables of a run that one of them has."""
    if mapping is None or mapping.header:
        return mapping
    sources = {}
    for channel, source in mapping.sources.items():
        if all(name in header for name, _ in source.terms):
            sources[channel] = source
    return replace(mapping, sources=sources)


def join(tables: Sequence[tuple[str, pd.DataFrame]]) -> tuple[pd.DataFrame, list[str]]:
    """Rows of several tables of one run, by time, and a line on what was joined.

    Tables whose clocks both count since 1970, or that overlap, have one clock. Others are taken to
    start together, which is said.

    Args:
        tables: Names and channels of the tables; the times increase.

    Raises:
        RecordingError: Two have the same channel, or were not recorded at the same time.
    """
    reference_name, reference = tables[0]
    name_of_table = dict.fromkeys(_channels(reference), reference_name)  # by channel
    joined = [reference]
    sources = [_source(reference_name, reference)]
    clocks = []
    for name, table in tables[1:]:
        for channel in _channels(table):
            if channel in name_of_table:
                earlier = name_of_table[channel]
                raise RecordingError(
                    f"{channel} is in {earlier} and in {name}; name one in a mapping file"
                )
            name_of_table[channel] = name
        ahead_s, how = _ahead_s(reference_name, reference["time_s"], name, table["time_s"])
        clocks.append(how)
        joined.append(table.assign(time_s=table["time_s"] - ahead_s))
        sources.append(_source(name, table))
    rows = pd.concat(joined).groupby("time_s", as_index=False).first()
    return rows, [f"tables of one run are joined: {'; '.join(sources)}", *clocks]


def _channels(table: pd.DataFrame) -> list[str]:
    """Channels of a table beside its time."""
    return [str(channel) for channel in table if channel != "time_s"]


def _source(name: str, table: pd.DataFrame) -> str:
    return f"{', '.join(_channels(table))} from {name}"


def _ahead_s(
    reference_name: str, reference_s: pd.Series[float], name: str, time_s: pd.Series[float]
) -> tuple[float, str]:
    """Time by which the clock of a table is ahead of that of the reference, s, and a line on how it
    is known."""
    reference_start_s = float(reference_s.iloc[0])
    start_s = float(time_s.iloc[0])
    end_of_both_s = min(float(reference_s.iloc[-1]), float(time_s.iloc[-1]))
    overlap_s = end_of_both_s - max(reference_start_s, start_s)
    if overlap_s > 0.0:
        return (
            0.0,
            f"times of {reference_name} and {name} overlap by {overlap_s:.4g} s: assumed to be of one clock",
        )
    ahead_s = start_s - reference_start_s
    if is_epoch(reference_start_s) and is_epoch(start_s):
        raise RecordingError(
            f"{reference_name} and {name} were not recorded at the same time: {abs(ahead_s):.6g} s lie "
            "between their starts"
        )
    durations_s = np.array([np.ptp(reference_s), np.ptp(time_s)])
    if durations_s.min() < thresholds.TOGETHER_SHARE * durations_s.max():
        raise RecordingError(
            f"{reference_name} lasts {durations_s[0]:.4g} s and {name} {durations_s[1]:.4g} s, on different clocks: "
            "give both times of one clock"
        )
    how = f"the clock of {name} is another: it is taken to start together with {reference_name}"
    return ahead_s, how
