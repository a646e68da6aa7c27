"""`diagnose.py`: exit 0 for any verdict, 2 with one line for input or output that cannot be
used."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import diagnose
from homeward import load_robot
from homeward.datasets import shipped_recording
from homeward.diagnosis import Analysis, Diagnosis, analyse, read_recording
from homeward.diagnosis import diagnose as diagnose_runs
from homeward.diagnosis.result import VERDICTS, Verdict
from homeward.diagnosis.tell.made_by import made_by
from tests.command_line import diagnosed


def refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str | Path
) -> str:
    """The one line with which a call is refused."""
    assert diagnosed(monkeypatch, *arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("diagnose.py: ")
    return lines[0]


def test_shipped_recording_without_data_or_network(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert diagnosed(monkeypatch, "--out", tmp_path / "out") == 0
    diagnosis = Diagnosis.from_json((tmp_path / "out" / "diagnosis.json").read_text())
    assert diagnosis.verdict == "missing_physics" and "turning" in diagnosis.where[0].condition
    assert diagnosis.made_by == made_by(0)
    printed = " ".join(capsys.readouterr().out.split())
    assert diagnosis.verdict in printed and diagnosis.summary in printed
    load_robot(tmp_path / "out" / "corrected.toml")
    assert shipped_recording().stat().st_size < 100_000


@pytest.mark.parametrize(("verdict", "code"), sorted(diagnose.EXIT_CODES.items()))
def test_each_verdict_has_its_exit_code_if_asked_for(
    verdict: Verdict, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysis = Analysis(
        Diagnosis("husky", (), verdict, ""), load_robot("husky"), load_robot("husky"), (), None
    )
    monkeypatch.setattr(diagnose, "main", lambda args: analysis)
    assert diagnosed(monkeypatch, "run.csv") == 0
    assert diagnosed(monkeypatch, "run.csv", "--exit-code") == code


def test_exit_codes_are_in_the_order_of_precedence_and_no_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert list(diagnose.EXIT_CODES.values()) == list(range(10, 15))
    assert set(diagnose.EXIT_CODES) == set(VERDICTS)
    # 2, whatever is asked for
    assert "no such file" in refused(monkeypatch, capsys, "none.csv", "--exit-code")
    assert "one verdict" in refused(
        monkeypatch, capsys, "--group", "a=x.csv", "--group", "b=y.csv", "--exit-code"
    )


def test_unusable_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = ("--out", tmp_path / "out")
    assert "no such file" in refused(monkeypatch, capsys, "none.csv", *out)
    good = shipped_recording()
    assert "presets:" in refused(monkeypatch, capsys, good, "--robot", "huskie", *out)
    assert "neither a file nor a shipped mapping" in refused(
        monkeypatch, capsys, good, "--columns", "none", *out
    )
    assert "known: husky_borealtc" in refused(monkeypatch, capsys, "--dataset", "kitti", *out)
    assert "not both" in refused(monkeypatch, capsys, good, "--dataset", "husky_borealtc", *out)
    assert not list((tmp_path).glob("out/*"))


def test_output_folder_that_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    assert "choose another --out" in refused(monkeypatch, capsys, "--out", tmp_path / "file")
    assert "choose another --out" in refused(monkeypatch, capsys, "--out", "/proc/none")


def test_an_interrupted_diagnosis_leaves_what_an_earlier_one_wrote(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert diagnosed(monkeypatch, "--out", out) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    capsys.readouterr()

    def ctrl_c(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    for moment in ("explain.explanation.name_missing", "tell.report.report_html"):
        monkeypatch.setattr(f"homeward.diagnosis.{moment}", ctrl_c)
        assert diagnosed(monkeypatch, "--out", out) == 130
        assert (
            capsys.readouterr().err.strip().splitlines()[-1].startswith("diagnose.py: interrupted")
        )
        assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def drive(seed: int = 0) -> pd.DataFrame:
    """A minute of a Husky-like drive."""
    rng, time_s = np.random.default_rng(seed), np.arange(600) / 10.0
    speed = np.clip(0.5 + 0.5 * np.sin(time_s / 7.0), 0.05, 1.0)
    return pd.DataFrame(
        {
            "time_s": time_s,
            "speed_mps": speed,
            "power_w": 60.0 + 120.0 * speed + rng.normal(0.0, 3.0, 600),
        }
    )


def test_what_is_assumed_and_how_a_table_was_read_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    drive().to_csv(tmp_path / "run.csv", index=False, sep=";", decimal=",")
    assert diagnosed(monkeypatch, tmp_path / "run.csv", "--out", tmp_path / "out") == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
    assert lines == [
        "no --robot is given: husky is assumed; name yours, a preset or a TOML file",
        "run.csv: read with cells separated by semicolons, decimal commas",
    ]
    assert (
        diagnosed(monkeypatch, tmp_path / "run.csv", "--robot", "husky", "--out", tmp_path / "out")
        == 0
    )
    assert "assumed" not in capsys.readouterr().err


def test_recordings_of_which_none_can_be_used_are_bad_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    drive().head(5).to_csv(tmp_path / "run.csv", index=False)
    assert (
        diagnosed(monkeypatch, tmp_path / "run.csv", "--robot", "husky", "--out", tmp_path / "out")
        == 2
    )
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert (
        last.startswith("diagnose.py: None of the recordings can be used: ") and "too short" in last
    )
    assert "too short" in (tmp_path / "out" / "report.html").read_text()


CHANNELS: dict[str, Callable[[pd.DataFrame], Any]] = {
    "sensing_hz": lambda table: 5.0 + 5.0 * np.sin(table.time_s / 11.0),
    "heading_rad": lambda table: np.cumsum(0.03 * np.sin(table.time_s / 5.0)),
    "base_distance_m": lambda table: np.cumsum(table.speed_mps) * 0.1,
    "temperature_c": lambda table: 20.0 + table.time_s / 30.0,
}


@pytest.mark.parametrize("lacking", [0, 1])
def test_runs_of_which_one_lacks_channels(lacking: int, tmp_path: Path) -> None:
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for seed, path in enumerate(paths):
        table = drive(seed)
        more = {} if seed == lacking else {name: values(table) for name, values in CHANNELS.items()}
        table.assign(**more).to_csv(path, index=False)
    analysis = analyse(paths, "husky")
    assert len(analysis.diagnosis.recordings) == 2
    (said,) = [one.text for one in analysis.findings if one.text.startswith("lacks ")]
    named, after = said.removeprefix("lacks ").split(", which other runs have")
    assert set(named.split(", ")) == set(CHANNELS) and "sensing rate is assumed to be 0" in after


def test_one_path_is_a_list_of_one(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    drive().to_csv(path, index=False)
    found = [diagnose_runs(one, "husky") for one in (str(path), path, read_recording(path), [path])]
    assert all(one == found[0] for one in found)
