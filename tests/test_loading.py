"""Ctrl-C while a command loads its modules: one line and exit code 130."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from homeward import loading
from homeward.__main__ import COMMANDS

SCRIPTS = ("train", "evaluate", "diagnose")
FIRST, LAST = "homeward.loading", "tyro"
"""Modules after which Ctrl-C comes: the first of this project, and the one that reads the
arguments, near the last."""


def words(command: str, root: Path) -> list[str]:
    return (
        [str(root / f"{command}.py")]
        if command in SCRIPTS
        else ["-m", "homeward", *command.split()[1:]]
    )


@pytest.mark.parametrize("after", [FIRST, LAST])
@pytest.mark.parametrize("command", [*SCRIPTS, *(f"homeward {name}" for name in COMMANDS)])
def test_ctrl_c_while_a_command_loads_is_one_line(
    command: str, after: str, root: Path, tmp_path: Path
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-X", "importtime", *words(command, root)],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(root)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    assert process.stderr is not None
    while process.stderr.readline().split("|")[-1].strip() != after:
        assert process.poll() is None, "it ended before it loaded that module"
    process.send_signal(signal.SIGINT)
    said = [
        line
        for line in process.communicate(timeout=60)[1].splitlines()
        if not line.startswith("import time:")
    ]
    program = f"{command}.py" if command in SCRIPTS else command.split()[0]
    assert len(said) == 1 and said[0].startswith(program) and ": interrupted: " in said[0]
    assert process.returncode == loading.INTERRUPTED
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("argv", "orig_argv", "name"),
    [
        (["/bin/homeward", "range"], ["python", "/bin/homeward", "range"], "homeward"),
        (["-m", "range"], ["python", "-m", "homeward", "range"], "homeward"),
        (["/elsewhere/train.py"], ["python", "/elsewhere/train.py"], None),
        (["-m"], ["python", "-m", "pytest"], None),
        # A process that a command starts has the command's arguments, but was not started with
        # them.
        (
            ["/bin/homeward", "sweep"],
            ["python", "-c", "spawn_main(...)", "--multiprocessing-fork"],
            None,
        ),
    ],
)
def test_only_commands_of_this_project_are_ended(
    argv: list[str], orig_argv: list[str], name: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", argv)
    monkeypatch.setattr(sys, "orig_argv", orig_argv)
    assert loading.program() == name


def test_a_program_that_imports_it_keeps_its_ctrl_c() -> None:
    code = "import signal, homeward; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
        == "True\n"
    )
