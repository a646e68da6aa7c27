"""The series that are written are those that the verdict rests on, in both formats, at the times of
the recording."""

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import diagnose
from homeward.diagnosis import Analysis
from homeward.diagnosis.tell.report import write_outputs
from homeward.diagnosis.tell.series import MCAP, PARQUET, mcap, series

ARMS = ("nominal", "refit", "corrected", "file")


@pytest.fixture(scope="module")
def folder(scrubbing: Analysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("out")
    write_outputs(scrubbing, path)
    return path


def test_the_parquet_file_holds_what_was_measured_and_predicted(
    folder: Path, scrubbing: Analysis
) -> None:
    table, evidence = pd.read_parquet(folder / PARQUET), scrubbing.evidence
    assert evidence is not None and scrubbing.diagnosis.fit is not None
    names = [*(f"{arm}_w" for arm in ARMS), *(f"residual_{arm}_w" for arm in ARMS)]
    assert list(table) == ["run", "time_s", "measured_w", *names]
    assert list(table["run"].unique()) == evidence.runs.names
    np.testing.assert_array_equal(table["time_s"], evidence.runs.time_s)
    np.testing.assert_array_equal(table["measured_w"], evidence.runs.observed)
    for arm in ARMS:
        np.testing.assert_array_equal(table[f"{arm}_w"], evidence.predictions[arm])
        np.testing.assert_array_equal(
            table[f"residual_{arm}_w"], table["measured_w"] - table[f"{arm}_w"]
        )
        rmse = float(np.sqrt(np.mean(table[f"residual_{arm}_w"] ** 2)))
        assert rmse == pytest.approx(scrubbing.diagnosis.fit.arms[arm].rmse, rel=1e-12)


def read_mcap(path: Path) -> dict[str, pd.DataFrame]:
    """Each topic of a file as a table, its definition taken from the file, with the time of each
    message in ns."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra logs")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    rows: dict[str, list[dict[str, Any]]] = {}
    with rosbag2.Reader(path) as reader:
        stores = {}
        for one in reader.connections:
            stores[one.topic] = get_typestore(Stores.EMPTY)
            stores[one.topic].register(get_types_from_msg(one.msgdef.data, one.msgtype))
        for one, time_ns, content in reader.messages():
            message = stores[one.topic].deserialize_cdr(content, one.msgtype)
            values = {
                name: value for name, value in vars(message).items() if not name.startswith("_")
            }
            rows.setdefault(one.topic, []).append({"time_ns": time_ns, **values})
    return {topic: pd.DataFrame(found) for topic, found in rows.items()}


def test_the_mcap_file_has_a_topic_for_each_run_with_the_same_numbers(folder: Path) -> None:
    table, topics = pd.read_parquet(folder / PARQUET), read_mcap(folder / MCAP)
    assert list(topics) == ["/run1_run0_csv", "/run2_run1_csv", "/run3_run2_csv", "/run4_run3_csv"]
    for (_, of_run), found in zip(table.groupby("run"), topics.values(), strict=True):
        np.testing.assert_allclose(found["time_ns"], of_run["time_s"] * 1e9, atol=1.0)
        for name in table.columns[2:]:
            np.testing.assert_array_equal(found[name], of_run[name])


def test_times_are_since_1970_where_the_recording_has_that(
    tmp_path: Path, scrubbing: Analysis
) -> None:
    evidence = scrubbing.evidence
    assert evidence is not None
    signals = [
        dataclasses.replace(run, start_s=1.7e9 + i) for i, run in enumerate(evidence.runs.signals)
    ]
    since = dataclasses.replace(evidence, runs=dataclasses.replace(evidence.runs, signals=signals))
    table = series(since)
    np.testing.assert_array_equal(table["time_s"], evidence.runs.time_s + 1.7e9 + evidence.runs.run)
    content = mcap(table)
    assert content is not None
    (tmp_path / MCAP).write_bytes(content)
    first_ns = [int(found["time_ns"].iloc[0]) for found in read_mcap(tmp_path / MCAP).values()]
    np.testing.assert_allclose(first_ns, table.groupby("run")["time_s"].first() * 1e9, atol=1e3)
    assert min(first_ns) > 1.7e18


def test_times_before_1970_and_names_that_are_no_text_can_be_written(
    tmp_path: Path, scrubbing: Analysis
) -> None:
    evidence = scrubbing.evidence
    assert evidence is not None
    signals = [
        dataclasses.replace(run, start_s=-500.0, name=f"\udcff{run.name}")
        for run in evidence.runs.signals
    ]
    odd = dataclasses.replace(evidence, runs=dataclasses.replace(evidence.runs, signals=signals))
    write_outputs(dataclasses.replace(scrubbing, evidence=odd), tmp_path)
    assert pd.read_parquet(tmp_path / PARQUET)["time_s"].max() < 0.0
    topics = read_mcap(tmp_path / MCAP)
    assert next(iter(topics)) == "/run1__run0_csv"
    assert all(found["time_ns"].iloc[0] == 0 for found in topics.values())


def test_motor_current_is_in_amperes(scrubbing: Analysis) -> None:
    evidence = scrubbing.evidence
    assert evidence is not None
    few = {"refit": evidence.predictions["refit"]}
    current = dataclasses.replace(
        evidence, runs=dataclasses.replace(evidence.runs, unit="A"), predictions=few
    )
    assert list(series(current)) == ["run", "time_s", "measured_a", "refit_a", "residual_refit_a"]


def test_without_rosbags_there_is_parquet_alone_and_a_line_says_so(
    tmp_path: Path,
    scrubbing: Analysis,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    written = write_outputs(scrubbing, tmp_path)
    assert {path.name for path in written} == {
        "diagnosis.json",
        "corrected.toml",
        "report.html",
        PARQUET,
    }
    diagnose._print(scrubbing, [], written)
    (line,) = [one for one in capsys.readouterr().err.splitlines() if "series" in one]
    assert line.startswith("no series.mcap, which needs rosbags: pip install ")


def test_without_a_usable_run_there_are_no_series(tmp_path: Path, scrubbing: Analysis) -> None:
    written = write_outputs(dataclasses.replace(scrubbing, evidence=None), tmp_path)
    assert {path.name for path in written} == {"diagnosis.json", "corrected.toml", "report.html"}
