"""Commands in forks of a process that has everything loaded and compiled, so that what is tried is their work."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

Run = Callable[[], int]
"""Runs the command line in `sys.argv`, and returns its exit code, as `homeward.__main__.run` does."""


def warm(run: Run, words: Sequence[str], folder: Path) -> None:
    """Run a command in this process, which then has loaded and compiled what forks of it need."""
    argv, sys.argv = sys.argv, ["homeward", *words]
    quiet = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
    try:
        with quiet[0], quiet[1], warnings.catch_warnings(action="ignore"), contextlib.chdir(folder):
            run()
    finally:
        sys.argv = argv


def fork(
    run: Run,
    words: Sequence[str],
    folder: Path,
    said: Path,
    printed: Path = Path(os.devnull),
    limit: Callable[[], object] = lambda: None,
) -> int:
    """Start a command in a child, the leader of a process group, which ends with 1 after a traceback.

    Args:
        run: What to call.
        words: Of the command line, after `homeward`.
        folder: Where it works.
        said: File of its stderr.
        printed: File of its stdout.
        limit: Called in the child before the command, such as to limit its memory.

    Returns:
        The child's number.
    """
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        for number, path in ((1, printed), (2, said)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.argv = ["homeward", *words]
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        sys.stdin = open(os.devnull)  # noqa: SIM115 - of a process that ends
        limit()
        code = run()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def wait(child: int, longest_s: float) -> tuple[int, float]:
    """Wait for a child, and kill its process group after so long.

    Returns:
        Its exit code, negative for a signal's number (-9 if it was killed here), and its processor time, s.
    """
    end_s = time.monotonic() + longest_s
    while True:
        ended, status, used = os.wait4(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime
        if time.monotonic() > end_s:
            with contextlib.suppress(ProcessLookupError):  # before it leads a group
                os.killpg(child, signal.SIGKILL)
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002)
