"""Missing packages: one line with the command to install them, instead of a traceback. Needs only
Python itself."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import metadata, util
from pathlib import Path

NEEDED = (
    "cloudpickle", "filelock", "gymnasium", "jinja2", "joblib", "numba", "numpy", "pandas", "pooch", "rich",
    "safetensors", "scipy", "threadpoolctl", "tyro",
)  # fmt: skip
"""Packages of every installation, by their import names."""

DIAGNOSE = ("plotly", "pyarrow", "ruptures", "sklearn")
"""Packages of the extra diagnose."""
OF_COMMANDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "diagnose": ("diagnose", DIAGNOSE),
    "fleet": ("diagnose", DIAGNOSE),
    "evaluate": ("plot", ("matplotlib",)),
    "sweep": ("train", ("matplotlib",)),
}
"""Extra of the commands that cannot load without it, and what of it they load; others say it where
they need it."""

_PACKAGE = {"sklearn": "scikit-learn"}  # where the package has another name
_ROOT = Path(__file__).resolve().parents[1]


def advice(extra: str, package: str) -> str:
    """The command that adds an extra to this installation of homeward.

    Args:
        extra: Name of the extra, such as `logs`.
        package: The missing package; installed itself if the installation is of a version without
            that extra.

    >>> advice("logs", "rosbags").startswith("pip install ")
    True
    """
    try:
        extras = metadata.metadata("homeward").get_all("Provides-Extra") or ()
    except metadata.PackageNotFoundError:
        if _is_checkout():  # on the path, and not a homeward from an index
            return f"pip install -e '{_ROOT}[{extra}]'"
        return f"pip install {package}"
    if extra in extras:
        return f"pip install 'homeward[{extra}]'"
    return f"pip install {package}"


def needed(extra: str, *packages: str) -> None:
    """End the program with exit code 2 and one line on stderr unless these can be imported; for
    scripts."""
    missing = [_PACKAGE.get(name, name) for name in _missing(packages)]
    if missing:
        _end(f"needs {' and '.join(missing)}: {advice(extra, ' '.join(missing))}")


def _missing(packages: Iterable[str]) -> list[str]:
    return [name for name in packages if util.find_spec(name) is None]


def _is_checkout() -> bool:
    return (_ROOT / "pyproject.toml").is_file()


def _refuse_incomplete() -> None:
    """End a program of this project, like `needed`, if a package of every installation is
    missing."""
    if not _is_own_program():
        return
    missing = _missing(NEEDED)
    if missing:
        _end(f"{sys.executable} does not have {', '.join(missing)}: {_remedy(missing)}")
    if _command() in OF_COMMANDS:
        extra, packages = OF_COMMANDS[_command()]
        needed(extra, *packages)


def _remedy(missing: list[str]) -> str:
    """What to do about missing packages of every installation: run the Python that has them, or
    install them."""
    python = _ROOT / ".venv" / "bin" / "python"
    if python.is_file():
        return f"run it with {python}"
    if _is_checkout():
        return f"install it with pip install -e '{_ROOT}'"
    packages = " ".join(_PACKAGE.get(name, name) for name in missing)
    return f"install it with pip install {packages}"


def _command() -> str:
    """Name of the subcommand, or of the script that is one."""
    program = Path(sys.argv[0])
    if program.name not in ("-m", "homeward"):
        return program.stem
    if len(sys.argv) == 1:
        return ""
    return sys.argv[1]


def _is_own_program() -> bool:
    if sys.argv[0] == "-m":  # while `python -m` imports the package, before it knows the file
        if "-m" not in sys.orig_argv:
            return False
        module = sys.orig_argv[sys.orig_argv.index("-m") + 1 :]
        return module[:1] == ["homeward"]
    program = Path(sys.argv[0])
    return program.name == "homeward" or (
        _is_checkout() and program.resolve().is_relative_to(_ROOT)
    )


def _end(message: str) -> None:
    program = Path(sys.argv[0]).name
    if program == "-m":
        program = "homeward"
    print(f"{program}: {message}", file=sys.stderr)
    raise SystemExit(2)


_refuse_incomplete()
