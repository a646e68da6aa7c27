"""Formats of time in recordings: seconds, counts since 1970 in s, ms, us or ns, dates, and the time
of day."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd

from homeward.logs import thresholds
from homeward.logs.channels import Array

_TIME_OF_DAY = r"\s*\d{1,2}:\d{2}:\d{2}(\.\d+)?\s*"
_DAY_FIRST = r"^\s*(\d{1,2})\.(\d{1,2})\.(\d{4})(?=\s)"
_DIGIT = r"\s*[-+]?\d"
_COMMA = r"(:\d{2}),(?=\d)"
_UNITS = ("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)


def median_step_s(time_s: Array) -> float:
    """Median time between samples, s."""
    if len(time_s) < 2:
        return np.inf
    return float(np.median(np.diff(time_s)))


def from_text(column: pd.Series[Any]) -> tuple[pd.Series[Any], str] | None:
    """Seconds of texts that are times, and what they are taken for; None where one is something
    else.

    Dates are ISO 8601 or, as German programs write them, 01.05.2024 12:00:00, UTC where they name
    no zone; times of day are such as 12:00:00.1. Fractions of a second may follow a decimal comma.
    """
    if pd.api.types.is_numeric_dtype(column) or not len(column):
        return None
    form = "ISO 8601"
    if pd.api.types.is_string_dtype(column):
        if not column.dropna().str.match(_DIGIT).all():
            return None  # pandas takes "now" and "today" for the present
        column = column.str.replace(_COMMA, r"\1.", regex=True)
        if column.str.match(_DAY_FIRST).all():
            column = column.str.replace(_DAY_FIRST, r"\3-\2-\1", regex=True)
            form = "day.month.year"
    seconds = _from_iso(column)
    if seconds is not None:
        return seconds, f"dates ({form}) as s since 1970"
    texts = column.astype(str)
    if not texts.str.fullmatch(_TIME_OF_DAY).all():
        return None
    return pd.to_timedelta(
        texts, errors="coerce"
    ).dt.total_seconds(), "times of day as s since midnight"


def _from_iso(column: pd.Series[Any]) -> pd.Series[Any] | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about texts that are no dates
            moments = pd.to_datetime(
                column, format="ISO8601", utc=True, errors="coerce"
            ).dt.as_unit("ns")
    except (ValueError, TypeError, OverflowError):
        return None
    if (moments.isna() & column.notna()).any() or moments.isna().all():
        return None
    return (moments.astype("int64") * 1e-9).where(moments.notna())


def is_epoch(time_s: float) -> bool:
    """Whether a time counts from 1970, and not from the start of a drive or of a computer."""
    return thresholds.EPOCH_S[0] < time_s < thresholds.EPOCH_S[1]


def from_epoch(time_s: Array) -> tuple[Array, str | None]:
    """Seconds of counts since 1970 in s, ms, us or ns, and the unit if it was not s; other times as
    they are.

    >>> from_epoch(np.array([1.7e12, 1.7e12 + 100.0]))[1]
    'ms'
    """
    if not len(time_s):
        return time_s, None
    start = float(time_s[0])
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    for unit, factor in _UNITS:
        if is_epoch(start * factor) and step * factor <= thresholds.LONGEST_STEP_S:
            other_unit = None if unit == "s" else unit
            return time_s * factor, other_unit
    return time_s, None
