"""The command `homeward` finds its subcommand, and says what there is where it finds none."""

import importlib
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import homeward
from homeward import __main__ as command
from tests.command_line import ended


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"], ["help"]])
def test_help_names_every_subcommand(words: list[str]) -> None:
    code, out, err = ended(words)
    assert (code, err) == (0, "") and out == command.usage()
    assert all(
        f"homeward {name} {arguments}" in out for name, (arguments, _) in command.COMMANDS.items()
    )
    assert max(map(len, out.splitlines())) <= 120
    starts = {
        line.index(does)
        for _, does in command.COMMANDS.values()
        for line in out.splitlines()
        if does in line
    }
    assert len(starts) == 1  # what they do stands in one column


def test_version() -> None:
    assert ended(["--version"]) == (0, f"homeward {homeward.__version__}\n", "")


def test_every_subcommand_is_a_module_and_the_other_way_round(root: Path) -> None:
    modules = {file.stem for file in (root / "homeward" / "commands").glob("*.py")} - {"__init__"}
    helpers = ("_plot", "_parts")  # of a command, in files of their own
    assert {name for name in modules if not name.endswith(helpers)} == set(command.COMMANDS)


@pytest.mark.parametrize("name", ["range", "fleet"])
def test_a_subcommand_runs_and_its_exit_code_is_that_of_the_command(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def load(module: str) -> SimpleNamespace:
        asked.append(module)
        return SimpleNamespace(run=lambda: 3)

    monkeypatch.setattr(importlib, "import_module", load)
    assert ended([name, "husky", "--help"])[0] == 3
    assert asked == [f"homeward.commands.{name}"]


@pytest.mark.parametrize(
    ("word", "hint"), [("rnage", " (did you mean 'range'?)"), ("xyz", ""), ("--nothing", "")]
)
def test_an_unknown_subcommand_takes_one_line(word: str, hint: str) -> None:
    code, out, err = ended([word])
    assert (code, out) == (2, "")
    assert (
        err.startswith(f"homeward: unknown command {word!r}{hint}; commands: range, train,")
        and err.count("\n") == 1
    )


def test_as_a_module_it_ends_with_the_exit_code(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "homeward", "rnage"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2 and done.stderr.startswith("homeward: unknown command 'rnage'")


def test_help_loads_nothing_heavy() -> None:
    program = "import sys, homeward.__main__ as m; sys.argv[1:] = ['--help']; m.run(); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.splitlines()[-1].split())
    assert not loaded & {
        "torch",
        "stable_baselines3",
        "pandas",
        "sklearn",
        "matplotlib.pyplot",
        "tyro",
        "pygame",
    }
