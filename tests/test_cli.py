"""All scripts end alike: 0, 2, or 130 after Ctrl-C, with one line unless all is well."""

import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import requests

import diagnose
import evaluate
import train
from homeward import RobotError, datasets


def end(
    script: ModuleType, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", [f"/somewhere/{script.__name__}.py", *arguments])
    return script.run(), capsys.readouterr().err


@pytest.mark.parametrize("script", [train, evaluate, diagnose], ids=lambda script: script.__name__)
@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (None, 0, ""),
        (KeyboardInterrupt(), 130, "interrupted: "),
        (RobotError("no\n  robot"), 2, "no robot\n"),
        (
            PermissionError(13, "Permission denied", "/out"),
            2,
            "cannot write /out: Permission denied; choose another --out",
        ),
    ],
)
def test_scripts_end_alike(
    script: ModuleType,
    error: BaseException | None,
    code: int,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def main(args: Any) -> None:
        if error is not None:
            raise error

    monkeypatch.setattr(script, "main", main)
    returned, said = end(script, [], monkeypatch, capsys)
    assert returned == code
    assert said.count("\n") == (error is not None)
    assert said.startswith(f"{script.__name__}.py: {message}" if error else "")


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (requests.exceptions.ConnectionError(), 3, "cannot be downloaded"),
        (requests.exceptions.HTTPError(), 3, "cannot be downloaded"),
        (OSError(28, "No space left on device"), 2, "cannot be written"),
    ],
)
def test_a_failed_download_has_an_exit_code_of_its_own(
    error: OSError,
    code: int,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.delenv(datasets.LOCAL_FOLDER, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(requests, "get", fail)
    monkeypatch.setattr(time, "sleep", lambda _: None)  # between tries
    arguments = ["--dataset", "husky_borealtc/FLOORING", "--out", str(tmp_path / "out")]
    returned, said = end(diagnose, arguments, monkeypatch, capsys)
    assert (returned, said.count("\n")) == (code, 1)
    assert message in said


def test_a_local_folder_without_the_data_is_wrong_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(datasets.LOCAL_FOLDER, str(tmp_path))
    arguments = ["--dataset", "husky_borealtc/FLOORING", "--out", str(tmp_path / "out")]
    returned, said = end(diagnose, arguments, monkeypatch, capsys)
    assert returned == 2
    assert "does not exist" in said
