"""`make demo` goes on without the real recordings only where they cannot be downloaded."""

import subprocess
from pathlib import Path

import pytest

PYTHON = """#!/bin/sh
echo "$@" >> {calls}
case "$*" in *--dataset*) exit {code};; esac
"""


@pytest.mark.parametrize(
    ("code", "falls_back"), [(0, False), (1, False), (2, False), (3, True), (130, False)]
)
def test_demo(code: int, falls_back: bool, tmp_path: Path, root: Path) -> None:
    calls = tmp_path / "calls"
    (tmp_path / "python").write_text(PYTHON.format(calls=calls, code=code))
    (tmp_path / "python").chmod(0o755)
    done = subprocess.run(
        [
            "make",
            "--assume-old=.venv/installed",
            f"BIN={tmp_path}",
            f"DEMO={tmp_path / 'demo'}",
            "demo",
        ],
        cwd=root,
        capture_output=True,
        text=True,
    )
    assert (done.returncode == 0) == (code in (0, 3)), done.stderr
    scripts = ["train.py", "evaluate.py", "diagnose.py"] + ["diagnose.py"] * falls_back
    called = calls.read_text().splitlines()
    assert [call.split()[0] for call in called] == scripts
    assert ("--dataset" in called[-1]) != falls_back
    assert {"--resume", "--replace"} <= set(called[0].split())
