"""The quickstart runs as a newcomer runs it, and leaves a clip that plays; a policy drives home from its ONNX file."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

pytest.importorskip("pygame")


def test_quickstart(tmp_path: Path, root: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(root / "examples" / "quickstart.py"), "--out", str(tmp_path / "new")],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("rusti_computer: 5.80 km on one charge, on the flat\ndmax_adaptive: home after ")
    assert "  rolling  " in done.stdout
    with Image.open(tmp_path / "new" / "mission.gif") as clip:
        decisions = int(done.stdout.split(" decisions")[0].split()[-1])
        assert clip.size == (720, 405)
        assert clip.n_frames == decisions + 1


def test_onnx_on_the_robot(tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    example = runpy.run_path(str(root / "examples" / "onnx_on_the_robot.py"))
    assert example["main"](example["Args"](out=tmp_path))
    printed = capsys.readouterr().out
    assert "the policy asks: go at 1 m/s, 0 Hz" in printed and "the policy asks: return at" in printed
    assert printed.splitlines()[-1].startswith("home after ")
