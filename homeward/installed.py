"""Missing packages: one line with the command to install them, instead of a traceback. Needs only Python itself."""

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
"""Extra of the commands that cannot load without it, and what of it they load; others say it where they need it."""

_PACKAGE = {"sklearn": "scikit-learn"}  # where the package has another name
_ROOT = Path(__file__).resolve().parents[1]


def advice(extra: str, package: str) -> str:
    """The command that adds an extra to this installation of homeward.

    Args:
        extra: Name of the extra, such as `logs`.
        package: The missing package; installed itself if the installation is of a version without that extra.

    >>> advice("logs", "rosbags").startswith("pip install ")
    True
    """
    try:
        about = metadata.metadata("homeward")
    except metadata.PackageNotFoundError:  # a checkout on the path, and not a homeward from an index
        return f"pip install -e '{_ROOT}[{extra}]'" if _is_checkout() else f"pip install {package}"
    known = extra in (about.get_all("Provides-Extra") or ())
    return f"pip install 'homeward[{extra}]'" if known else f"pip install {package}"


def needed(extra: str, *packages: str) -> None:
    """End the program with exit code 2 and one line on stderr unless these can be imported; for scripts."""
    missing = [_PACKAGE.get(name, name) for name in _missing(packages)]
    if missing:
        _end(f"needs {' and '.join(missing)}: {advice(extra, ' '.join(missing))}")


def _missing(packages: Iterable[str]) -> list[str]:
    return [name for name in packages if util.find_spec(name) is None]


def _is_checkout() -> bool:
    return (_ROOT / "pyproject.toml").is_file()


def _refuse_incomplete() -> None:
    """End a program of this project, like `needed`, if a package of every installation is missing."""
    if _is_own_program() and (missing := _missing(NEEDED)):
        python = _ROOT / ".venv" / "bin" / "python"
        install = (
            f"pip install -e '{_ROOT}'"
            if _is_checkout()
            else f"pip install {' '.join(_PACKAGE.get(name, name) for name in missing)}"
        )
        known = f"run it with {python}" if python.is_file() else f"install it with {install}"
        _end(f"{sys.executable} does not have {', '.join(missing)}: {known}")
    if _is_own_program() and _command() in OF_COMMANDS:
        extra, packages = OF_COMMANDS[_command()]
        needed(extra, *packages)


def _command() -> str:
    """Name of the subcommand, or of the script that is one."""
    program = Path(sys.argv[0])
    if program.name in ("-m", "homeward"):
        return sys.argv[1] if len(sys.argv) > 1 else ""
    return program.stem


def _is_own_program() -> bool:
    module = sys.orig_argv[sys.orig_argv.index("-m") + 1 :] if "-m" in sys.orig_argv else []
    if sys.argv[0] == "-m":  # while `python -m` imports the package, before it knows the file
        return module[:1] == ["homeward"]
    program = Path(sys.argv[0])
    return program.name == "homeward" or (_is_checkout() and program.resolve().is_relative_to(_ROOT))


def _end(message: str) -> None:
    print(f"{Path(sys.argv[0]).name if sys.argv[0] != '-m' else 'homeward'}: {message}", file=sys.stderr)
    raise SystemExit(2)


_refuse_incomplete()
