"""How the scripts run from the command line, and how they end."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import tyro

Args = TypeVar("Args")

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal, as shells have it."""


def run(
    main: Callable[[Args], Any],
    args: Callable[..., Args],
    description: str | None,
    refused: tuple[type[Exception], ...],
    interrupted: str = "nothing half-written is left",
) -> int:
    """Run the `main` of a script or a subcommand of `homeward` with the arguments of the command line.

    Args:
        main: Does the work; what it returns is dropped.
        args: Dataclass of the arguments.
        description: Shown by `--help`.
        refused: Exceptions that say in one line what cannot be used and what to do.
        interrupted: Said after Ctrl-C.

    Returns:
        Exit code: 0; 130 after Ctrl-C; 2 for input or output that cannot be used, or the error's own `exit_code`.
        All but 0 come with one line on stderr.
    """
    program, arguments = _called()
    try:
        main(tyro.cli(args, prog=program, args=arguments, description=description))
    except refused as error:
        code, message = getattr(error, "exit_code", 2), str(error)
    except OSError as error:
        code = 2
        message = f"cannot write {error.filename or 'the output'}: {error.strerror or error}; choose another --out"
    except KeyboardInterrupt:
        code, message = INTERRUPTED, f"interrupted: {interrupted}"
    else:
        return 0
    print(f"{program}: {' '.join(message.split())}", file=sys.stderr)
    return code


def _called() -> tuple[str, list[str]]:
    """Name and arguments of what was called: a script, or a subcommand of `homeward`."""
    path, arguments = Path(sys.argv[0]), sys.argv[1:]
    if arguments and (path.stem == "homeward" or (path.parent.name, path.name) == ("homeward", "__main__.py")):
        return f"homeward {arguments[0]}", arguments[1:]
    return path.name, arguments
