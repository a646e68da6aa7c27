"""`diagnose.py`: exit 0 for any verdict, 2 with one line for input or output that cannot be used."""

import sys
from pathlib import Path

import pytest

import diagnose
from homeward import load_robot
from homeward.datasets import shipped_recording
from homeward.diagnosis import Diagnosis


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["diagnose.py", *map(str, arguments)])
    return diagnose.run()


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The one line with which a call is refused."""
    assert run(monkeypatch, *arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("diagnose.py: ")
    return lines[0]


def test_shipped_recording_without_data_or_network(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(monkeypatch, "--out", tmp_path / "out") == 0
    diagnosis = Diagnosis.from_json((tmp_path / "out" / "diagnosis.json").read_text())
    assert diagnosis.verdict == "missing_physics" and "turning" in diagnosis.where[0].condition
    printed = " ".join(capsys.readouterr().out.split())
    assert diagnosis.verdict in printed and diagnosis.summary in printed
    load_robot(tmp_path / "out" / "corrected.toml")
    assert shipped_recording().stat().st_size < 100_000


def test_unusable_input(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out")
    assert "no such file" in refused(monkeypatch, capsys, "none.csv", *out)
    good = shipped_recording()
    assert "presets:" in refused(monkeypatch, capsys, good, "--robot", "huskie", *out)
    assert "neither a file nor one that ships" in refused(monkeypatch, capsys, good, "--columns", "none", *out)
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
    assert run(monkeypatch, "--out", out) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    capsys.readouterr()

    def ctrl_c(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    for moment in ("explain.explanation.name_missing", "tell.report.report_html"):
        monkeypatch.setattr(f"homeward.diagnosis.{moment}", ctrl_c)
        assert run(monkeypatch, "--out", out) == 130
        assert capsys.readouterr().err.strip().splitlines()[-1].startswith("diagnose.py: interrupted")
        assert {path.name: path.read_bytes() for path in out.iterdir()} == before
