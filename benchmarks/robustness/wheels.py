"""Build a wheel and an sdist from a clean checkout, install each into empty environments, and run the README there.

`python benchmarks/robustness/wheels.py` clones the checkout's last commit, builds both, and for every Python from 3.11
to 3.13 that is to be had (`--pythons` names others) makes a virtual environment, installs each of the two with the
extra `train` and the versions of constraints.txt, and there, outside the checkout, runs the README's `>>>` examples and
commands of every kind. It needs a package index.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

ROOT = Path(__file__).resolve().parents[2]
VERSIONS = ("3.11", "3.12", "3.13")
_LONGEST_S = 1800.0  # of a command, such as an installation; chosen: what takes longer hangs

_README = """
import doctest, pathlib, sys
import homeward
assert "site-packages" in homeward.__file__, homeward.__file__
failed, tried = doctest.testfile(sys.argv[1], module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
print(f"{tried} examples, {failed} failed")
sys.exit(failed > 0 or tried == 0)
"""
_COMMANDS = (
    ["range", "rusti", "--grade", "5.71", "--duty", "0.367"],
    ["evaluate", "--env", "homeward/Survey-v0", "--agents", "soc50", "dmax_adaptive", "ppo", "--episodes", "10",
     "--out", "first"],
    ["diagnose", "--out", "diagnosis"],
    ["train", "--env", "homeward/OutAndBack-v0", "--steps", "4096", "--n-envs", "32", "--n-steps", "64",
     "--batch-size", "256", "--out", "ppo"],
)  # fmt: skip


@dataclass(frozen=True)
class Args:
    """With which Pythons."""

    pythons: tuple[Path, ...] = ()
    """Executables of Python; those of versions 3.11 to 3.13 that are found if left out."""


def find_pythons() -> list[Path]:
    """A Python of each version, on the path or installed by pyenv."""
    found = []
    for version in VERSIONS:
        by_pyenv = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
        near = [Path(one) for one in (shutil.which(f"python{version}"), *by_pyenv) if one]
        found += [one for one in near if _version(one).startswith(version)][:1]
    return found


def _version(python: Path) -> str:
    answer = subprocess.run([python, "-c", "import platform; print(platform.python_version())"], capture_output=True,
                            text=True)  # fmt: skip
    return answer.stdout.strip()


def build(folder: Path) -> tuple[Path, Path]:
    """A wheel and an sdist of the last commit."""
    source, made = folder / "source", folder / "made"
    _run(["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(source)], folder)
    python = folder / "build" / "bin" / "python"
    _run([sys.executable, "-m", "venv", str(folder / "build")], folder)
    _run([python, "-m", "pip", "install", "--quiet", "build"], folder)
    _run([python, "-m", "build", "--outdir", str(made), str(source)], folder)
    return next(made.glob("*.whl")), next(made.glob("*.tar.gz"))


def cases(pythons: Sequence[Path], wheel: Path, sdist: Path) -> list[tuple[Path, str, Path]]:
    """What is installed: a wheel and an sdist with each Python."""
    return [(python, kind, package) for kind, package in (("wheel", wheel), ("sdist", sdist)) for python in pythons]


def install(python: Path, package: Path, folder: Path) -> dict[str, str]:
    """Install a package into an empty environment and use it outside the checkout.

    Returns:
        By step "", or the last line that was said where it went wrong.
    """
    folder.mkdir()
    inside = folder / "venv" / "bin" / "python"
    steps: dict[str, list[str | Path]] = {
        "venv": [python, "-m", "venv", str(folder / "venv")],
        "install": [inside, "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt"), f"{package}[train]"],
        "README": [inside, "-c", _README, str(ROOT / "README.md")],
        **{line[0]: [inside.parent / "homeward", *line] for line in _COMMANDS},
    }
    said: dict[str, str] = {}
    for name, line in steps.items():
        said[name] = _run(line, folder, fail=False)
        if said[name] and name in ("venv", "install"):
            break
    shutil.rmtree(folder / "venv", ignore_errors=True)
    return said


def _run(line: list[str | Path], folder: Path, fail: bool = True) -> str:
    """ "" if a command ends with 0, or the last line that it said."""
    try:
        env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # or the checkout is imported
        done = subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=_LONGEST_S, env=env)
    except subprocess.TimeoutExpired:
        return f"took more than {_LONGEST_S:g} s"
    if done.returncode == 0:
        return ""
    said = (done.stderr.strip() or done.stdout.strip() or f"code {done.returncode}").splitlines()[-1]
    if fail:
        raise SystemExit(f"{' '.join(map(str, line))}: {done.stderr}")
    return said


def main(args: Args) -> bool:
    """Build, install everywhere, and print a table; whether all went well."""
    pythons, all_well = list(args.pythons) or find_pythons(), True
    print("| Python | package | README and commands |\n|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as name:
        for number, (python, kind, package) in enumerate(cases(pythons, *build(Path(name)))):
            steps = install(python, package, Path(name) / f"environment_{number}")
            wrong = "; ".join(f"{step}: {said}" for step, said in steps.items() if said)
            well = f"all well: {', '.join(steps)}"
            print(f"| {_version(python)} | {kind} | {wrong or well} |", flush=True)
            all_well &= not wrong
    return all_well


if __name__ == "__main__":
    sys.exit(0 if main(tyro.cli(Args, description=__doc__)) else 1)
