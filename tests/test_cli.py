"""All scripts end alike: 0, 2, or 130 after Ctrl-C, with one line unless all is well."""

import os
import signal
import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import requests
from rich.table import Table

import diagnose
import evaluate
import train
from homeward import RobotError, cli, datasets


def end(
    script: ModuleType,
    arguments: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
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


def test_ctrl_c_that_compiled_code_makes_another_error_of_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unboxed(args: Any) -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10.0)
        except KeyboardInterrupt:
            raise TypeError("can't unbox a List as a <NULL>") from None

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        monkeypatch.setattr(train, "main", unboxed)
        assert end(train, [], monkeypatch, capsys) == (
            130,
            "train.py: interrupted: continue with --resume\n",
        )
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


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


@pytest.mark.parametrize("name", ["[red]robot[/red]", "\x1b[31mrobot", "ro\rbot", ":robot:", "[/]"])
def test_names_are_printed_as_text(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(title=name)
    table.add_column(name)
    table.add_row(name)
    terminal = cli.Terminal()
    terminal.print(table)
    terminal.print(name, soft_wrap=True)
    shown = "".join(c if c.isprintable() else "?" for c in name)
    assert capsys.readouterr().out.count(shown) == 4


def test_a_warning_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["/somewhere/tool.py"])

    def main(_: object) -> None:
        warnings.simplefilter("always")
        warnings.warn("look\n here \x1b[31m", stacklevel=1)

    assert cli.run(main, Nothing, None, ()) == 0
    assert capsys.readouterr().err == "tool.py: warning: look here ?[31m\n"


def test_a_table_that_is_piped_has_its_full_width(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    table = Table("a heading of several words", "another")
    table.add_row("cells " * 20, "b")
    console = cli.Terminal()
    console.show(table, ("another",))
    assert "cells " * 19 in capsys.readouterr().out and console.width == 80


def test_a_table_leaves_out_only_columns_that_it_has(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "24")
    table = Table("agent", "score", "us")
    table.add_row("a long name", "123456789", "123456789")
    cli.Terminal().show(table, ("us", "optimum", "score"))
    output = " ".join(capsys.readouterr().out.split())
    assert "Left out in a terminal of 24 columns: us, score." in output


def test_a_long_message_is_cut(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["/somewhere/tool.py"])

    def main(_: object) -> None:
        raise RobotError("x" * 10**6)

    assert cli.run(main, Nothing, None, (RobotError,)) == 2
    assert len(capsys.readouterr().err) < 3000


@dataclass(frozen=True)
class Nothing:
    """No arguments."""


def test_no_argument_reaches_the_terminal_as_an_escape(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = end(evaluate, ["--agents", "soc50", "\x1b[31m"], monkeypatch, capsys)
    assert code == 2
    assert (
        said
        == "evaluate.py: argument '?[31m' holds a control character: type it again, or rename the file\n"
    )
