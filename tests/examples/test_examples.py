"""The quickstart runs as a newcomer runs it, and leaves a clip that plays; a policy drives home
from its ONNX file; the notebook runs from top to bottom."""

import runpy
from pathlib import Path

import pytest

from tests.command_line import example_ended


def test_quickstart(tmp_path: Path) -> None:
    pytest.importorskip("pygame")
    image = pytest.importorskip("PIL.Image")
    code, printed, said = example_ended("quickstart", "--out", str(tmp_path / "new"))
    assert code == 0, said
    assert printed.startswith(
        "rusti_computer: 5.80 km on one charge, on the flat\ndmax_adaptive: home after "
    )
    assert "  rolling  " in printed
    with image.open(tmp_path / "new" / "mission.gif") as clip:
        decisions = int(printed.split(" decisions")[0].split()[-1])
        assert clip.size == (720, 405)
        assert clip.n_frames == decisions + 1


def test_onnx_on_the_robot(tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    example = runpy.run_path(str(root / "examples" / "onnx_on_the_robot.py"))
    assert example["main"](example["Args"](out=tmp_path))
    printed = capsys.readouterr().out
    assert (
        "action of the policy: go at 1 m/s, 0 Hz" in printed
        and "action of the policy: return at" in printed
    )
    assert printed.splitlines()[-1].startswith("home after ")


def test_the_notebook_runs_from_top_to_bottom(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    for name in ("JUPYTER_RUNTIME_DIR", "JUPYTER_DATA_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path / name))
    # as a notebook has it
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    notebook = nbformat.read(root / "examples" / "first_hour.ipynb", as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in cells)  # nothing is stored
    nbclient.NotebookClient(
        notebook, timeout=None, resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    for cell in cells[1:]:
        assert sum("image/png" in output.get("data", {}) for output in cell.outputs) == 1
    printed = ["".join(output.get("text", "") for output in cell.outputs) for cell in cells]
    assert printed[1].startswith("husky: 10.87 km at 1.00 m/s")
    assert "home: True, score " in printed[2] and "consumed most by rolling" in printed[2]
    scores = [float(line.split("mean score ")[1].split(",")[0]) for line in printed[3].splitlines()]
    assert scores[1] > scores[0] > 0.0
    assert "parameters_off" in printed[4]
