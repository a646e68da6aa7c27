"""What is not installed is said in one line, with the command that installs it."""

import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from homeward import installed
from homeward.__main__ import COMMANDS
from homeward.installed import NEEDED, OF_COMMANDS, advice

ROOT = Path(__file__).parents[1]


def test_what_every_installation_has_is_what_the_project_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    asked = {line.partition(">=")[0] for line in project["dependencies"]}
    assert {"scikit-learn" if name == "sklearn" else name for name in NEEDED} == asked


def test_what_commands_load_of_an_extra_is_in_it() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    for extra, packages in OF_COMMANDS.values():
        brought = {line.partition(">=")[0] for line in extras[extra]}
        assert {"scikit-learn" if name == "sklearn" else name for name in packages} <= brought
    assert {line for name in ("diagnose", "plot", "logs") for line in extras[name]} <= set(
        extras["dev"]
    )


OF_EXTRAS = (
    "PIL", "backports", "cyclonedds", "fitdecode", "foxglove", "gpxpy", "lz4", "matplotlib", "optuna", "plotly",
    "pyarrow", "pygame", "pymavlink", "pyulog", "ray", "rosbags", "ruptures", "sklearn", "stable_baselines3",
    "tensorboard", "torch",
)  # fmt: skip
"""What the extras bring, by its import names."""


def test_a_robot_needs_none_of_the_extras() -> None:
    modules = [
        "homeward.agents.evaluation",
        "homeward.companion",
        "homeward.envs",
        "homeward.logs",
        "homeward.watch.live",
    ]
    modules += [f"homeward.commands.{name}" for name in COMMANDS if name not in OF_COMMANDS]
    code = (
        f"import importlib, sys\nfor name in {OF_EXTRAS}: sys.modules[name] = None\n"
        f"for name in {modules}: importlib.import_module(name)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "lacks"),
    [
        (
            ["/bin/homeward", "diagnose", "run.csv"],
            "plotly and pyarrow and ruptures and scikit-learn",
        ),
        (["-m", "fleet"], "plotly and pyarrow and ruptures and scikit-learn"),
        (["/bin/homeward", "sweep"], "matplotlib"),
        ([str(ROOT / "evaluate.py")], "matplotlib"),
        (["/bin/homeward", "range", "husky"], None),
        (["/bin/homeward"], None),
        (["/elsewhere/diagnose.py"], None),  # another program
    ],
)
def test_a_command_says_which_extra_it_lacks(
    arguments: list[str],
    lacks: str | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", arguments)
    monkeypatch.setattr(sys, "orig_argv", ["python", "-m", "homeward", *arguments[1:]])
    monkeypatch.setattr(
        installed, "_missing", lambda packages: [name for name in packages if name not in NEEDED]
    )
    if lacks is None:
        installed._refuse_incomplete()
        return
    with pytest.raises(SystemExit) as end:
        installed._refuse_incomplete()
    said = capsys.readouterr().err
    assert end.value.code == 2 and said.count("\n") == 1
    assert f": needs {lacks}: pip install " in said


def test_every_extra_that_the_code_names_is_one() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    named = {
        part.split('"')[1] if part[0] == '"' else part.split("'")[1]
        for file in [*ROOT.glob("*.py"), *(ROOT / "homeward").rglob("*.py"), *(ROOT / "envs").rglob("*.py"),
                     *(ROOT / "agents").rglob("*.py"), *(ROOT / "examples").glob("*.py")]
        for part in file.read_text("utf-8").replace("needed(", "advice(").split("advice(")[1:]
        if part[0] in "'\""
    }  # fmt: skip
    assert {"examples,train", "logs", "onnx", "ray", "train", "view"} <= named
    assert {one for group in named for one in group.split(",")} <= set(extras)


def test_the_page_of_help_lists_every_extra_that_users_want() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    listed = (
        (ROOT / "docs" / "help.md").read_text("utf-8").partition("extras are ")[2].partition("|")[0]
    )
    own = {"concealed", "dev", "release"}  # of those who work on the project
    assert set(listed.split("`")[1::2]) == set(extras) - own


@pytest.mark.parametrize(
    "script", ["train.py", "evaluate.py", "diagnose.py", "-m homeward", "-m homeward range husky"]
)
def test_a_python_without_the_packages_gets_one_line(script: str) -> None:
    found = subprocess.run(
        [sys.executable, "-I", "-S", "-c", RUN, *script.split()],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert found.returncode == 2
    (line,) = found.stderr.splitlines()
    assert (
        "does not have" in line and "tyro" in line and "pip install" in line
    ) or ".venv/bin/python" in line


@pytest.mark.parametrize("example", sorted(path.name for path in (ROOT / "examples").glob("*.py")))
def test_an_example_that_finds_no_homeward_says_so_in_one_line(example: str) -> None:
    found = subprocess.run(
        [sys.executable, "-I", "-S", str(ROOT / "examples" / example)],
        capture_output=True,
        text=True,
    )
    (line,) = found.stderr.splitlines()
    assert found.returncode != 0 and "needs homeward: pip install -e '.[" in line


RUN = f"""
import runpy, sys
sys.path.insert(0, {str(ROOT)!r})
sys.argv = sys.argv[1:]
sys.orig_argv = ["python", *sys.argv]
if sys.argv[0] == "-m":
    name = sys.argv[1]
    sys.argv[:2] = ["-m"]
    runpy.run_module(name, run_name="__main__", alter_sys=False)
else:
    runpy.run_path(sys.argv[0], run_name="__main__")
"""


def test_a_needed_package_ends_a_script(capsys: pytest.CaptureFixture[str]) -> None:
    installed.needed("train", "numpy")
    with pytest.raises(SystemExit) as end:
        installed.needed("train", "numpy", "no_such_package")
    assert end.value.code == 2
    assert "needs no_such_package: pip install " in capsys.readouterr().err


def test_advice_follows_how_it_was_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert advice("no_such_extra", "rosbags") == "pip install rosbags"

    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.metadata", missing)
    assert advice("logs", "rosbags") == f"pip install -e '{ROOT}[logs]'"
    monkeypatch.setattr(installed, "_ROOT", Path("/nowhere"))
    assert advice("logs", "rosbags") == "pip install rosbags"
