"""Formats of time: what is read as seconds, by itself and in a recording."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.diagnosis import read_recording
from homeward.logs.channels import Array
from homeward.logs.times import from_epoch, from_text, is_epoch, median_step_s
from tests.logs.refused import Write, refusal


@pytest.mark.parametrize(
    ("texts", "seconds"),
    [
        (["1970-01-01T00:00:10Z", "1970-01-02T00:00:00Z"], [10.0, 86400.0]),
        (["1970-01-01 02:00:00+02:00"], [0.0]),
        (["1970-01-01 00:00:00,25"], [0.25]),
        (["01.02.1970 00:00:01"], [31 * 86400.0 + 1.0]),  # the day comes first
        (["0:00:01", "12:00:00.5", "23:59:59,75"], [1.0, 43200.5, 86399.75]),
    ],
)
def test_texts_that_are_times(texts: list[str], seconds: list[float]) -> None:
    found = from_text(pd.Series(texts))
    assert found is not None
    np.testing.assert_allclose(found[0], seconds, atol=1e-6)


def test_a_missing_date_stays_missing() -> None:
    found = from_text(pd.Series(["1970-01-01T00:00:10Z", None, "1970-01-01T00:00:30Z"]))
    assert found is not None
    np.testing.assert_allclose(found[0], [10.0, np.nan, 30.0])


@pytest.mark.parametrize(
    "column",
    [
        [1.0, 2.0],
        [],
        ["now"],
        ["1970-01-01", "today"],
        ["05/01/2024"],
        ["12:00"],
        ["12:00:00", "x"],
        [None],
    ],
)
def test_what_is_no_text_of_a_time_is_none(column: list[object]) -> None:
    assert from_text(pd.Series(column)) is None


@pytest.mark.parametrize(("unit", "factor"), [(None, 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("first_s", [7e8, 1.7e9, 4e9])
def test_counts_since_1970_are_seconds(unit: str | None, factor: float, first_s: float) -> None:
    time_s: Array = first_s + 0.5 * np.arange(5.0)
    found, said = from_epoch(time_s * factor)
    np.testing.assert_allclose(found, time_s, rtol=1e-12)
    assert said == unit


@pytest.mark.parametrize(
    "time_s", [[0.0, 0.1, 0.2], [], [1e5, 1e5 + 1.0], [1.7e9, 1.7e9 + 1000.0, 1.7e9 + 2000.0]]
)
def test_other_times_stay_as_they_are(time_s: list[float]) -> None:
    """From the start of a drive or of a computer, none at all, and with steps of a quarter of an
    hour."""
    found, said = from_epoch(np.array(time_s))
    assert found.tolist() == time_s and said is None


def test_the_epoch_is_from_1990_to_2099() -> None:
    moments = [pd.Timestamp(year, 1, 2).timestamp() for year in (1985, 1991, 2025, 2098, 2101)]
    assert list(map(is_epoch, [0.0, *moments])) == [False, False, True, True, True, False]


def test_the_median_step_is_that_of_most_samples() -> None:
    assert median_step_s(np.array([0.0, 0.1, 0.2, 9.0, 9.1])) == pytest.approx(0.1)
    assert median_step_s(np.array([5.0])) == np.inf == median_step_s(np.array([]))


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_time_since_1970(table: pd.DataFrame, csv: Write, factor: float, unit: str) -> None:
    since_s = table["time_s"].copy()
    table["time_s"] = (factor * since_s).round(9).astype(
        "int64" if factor > 1.0 else float
    ) + 1_650_000_000 * int(factor)
    recording = read_recording(csv(table))
    np.testing.assert_allclose(recording.channels["time_s"] - 1.65e9, since_s, atol=1e-6)
    assert recording.notes == (
        () if unit == "s" else (f"time_s is in {unit}, read as s since 1970",)
    )


@pytest.mark.parametrize("zone", ["Z", "+02:00", ""])
def test_dates(table: pd.DataFrame, csv: Write, zone: str) -> None:
    moments = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(table["time_s"], unit="s")
    recording = read_recording(
        csv(table.assign(time_s=[f"{one.isoformat()}{zone}" for one in moments]))
    )
    time_s = recording.channels["time_s"]
    np.testing.assert_allclose(time_s - time_s[0], table["time_s"], atol=1e-6)
    assert time_s[0] == pd.Timestamp(f"2024-05-01 12:00:00{zone}").timestamp()
    assert recording.notes == ("read with dates (ISO 8601) as s since 1970",)


@pytest.mark.parametrize(
    ("form", "taken"),
    [("%d.%m.%Y %H:%M:%S,%f", "dates (day.month.year) as s since 1970"),
     ("%Y-%m-%d %H:%M:%S,%f", "dates (ISO 8601) as s since 1970"), ("%H:%M:%S,%f", "times of day as s since midnight")],
)  # fmt: skip
def test_times_as_german_programs_write_them(
    table: pd.DataFrame, csv: Write, form: str, taken: str
) -> None:
    moments = pd.Timestamp("2024-03-05 12:00:00") + pd.to_timedelta(table["time_s"], unit="s")
    recording = read_recording(csv(table.assign(time_s=moments.dt.strftime(form))))
    time_s = recording.channels["time_s"]
    np.testing.assert_allclose(time_s - time_s[0], table["time_s"], atol=1e-6)
    assert recording.notes == (f"read with {taken}",)
    if "%d" in form:
        assert time_s[0] == pd.Timestamp("2024-03-05 12:00:00Z").timestamp()


def test_dates_in_a_parquet_file(table: pd.DataFrame, tmp_path: Path) -> None:
    moments = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(table["time_s"], unit="s")
    table.assign(time_s=moments).to_parquet(tmp_path / "run.parquet")
    time_s = read_recording(tmp_path / "run.parquet").channels["time_s"]
    np.testing.assert_allclose(time_s - time_s[0], table["time_s"], atol=1e-6)


def test_times_of_day(table: pd.DataFrame, csv: Write) -> None:
    stamps = pd.to_datetime(12 * 3600 + table["time_s"], unit="s").dt.strftime("%H:%M:%S.%f")
    recording = read_recording(csv(table.assign(time_s=stamps)))
    np.testing.assert_allclose(recording.channels["time_s"], 12 * 3600 + table["time_s"], atol=1e-6)
    assert recording.notes == ("read with times of day as s since midnight",)
    american = csv(table.assign(time_s="05/01/2024 12:00:00 PM"))
    assert (
        "row 1 is '05/01/2024 12:00:00 PM', neither a number nor a time such as 2024-05-01T"
        in refusal(american)
    )
