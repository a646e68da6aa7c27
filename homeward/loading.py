"""Ctrl-C while the modules of a command load: one line and exit code 130, as later. Needs only
Python itself."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path
from types import FrameType

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 plus the number of the signal, as in shells."""

_ROOT = Path(__file__).resolve().parents[1]
_PROGRAMS = ("train.py", "evaluate.py", "diagnose.py")


def program() -> str | None:
    """Name of the command of this project that this process was started as, None if it is another
    program.

    Processes that a command starts are other programs: the command itself says that it was
    interrupted.
    """
    if sys.argv[0] == "-m":  # while `python -m` imports the package, before it knows the file
        module = sys.orig_argv[sys.orig_argv.index("-m") + 1]
        if module.split(".")[0] == "homeward":
            return "homeward"
        return None
    path = Path(sys.argv[0])
    is_ours = path.name == "homeward" or path.resolve() in [_ROOT / name for name in _PROGRAMS]
    if is_ours and sys.argv[0] in sys.orig_argv:
        return path.name
    return None


_PROGRAM = program()


def end_at_once(number: int, frame: FrameType | None) -> None:
    """Handle Ctrl-C: end the process, in which nothing is half-written yet."""
    print(f"{_PROGRAM}: interrupted: nothing half-written is left", file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)


def _end_at_once_on_ctrl_c() -> None:
    """From now on handle Ctrl-C so, if this process is a command of this project and does not
    handle it otherwise."""
    as_python_does = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if (
        as_python_does
        and _PROGRAM is not None
        and threading.current_thread() is threading.main_thread()
    ):
        signal.signal(signal.SIGINT, end_at_once)


_end_at_once_on_ctrl_c()
