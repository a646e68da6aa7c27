"""Commands in this process."""

from __future__ import annotations

import contextlib
import io
import sys
import warnings
from pathlib import Path

import pytest

import diagnose
from homeward import __main__ as command


def ended(words: list[str]) -> tuple[int, str, str]:
    """Exit code of `homeward WORDS`, what it printed and what it said."""
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(pytest.MonkeyPatch.context()).setattr(sys, "argv", ["homeward", *words])
        stack.enter_context(contextlib.redirect_stdout(printed))
        stack.enter_context(contextlib.redirect_stderr(said))
        stack.enter_context(warnings.catch_warnings(action="ignore"))
        try:
            code: object = command.run()
        except SystemExit as end:  # of a word that no option has
            code = end.code
    return int(str(code)), printed.getvalue(), said.getvalue()


def diagnosed(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    """Exit code of `diagnose.py ARGUMENTS`."""
    monkeypatch.setattr(sys, "argv", ["diagnose.py", *map(str, arguments)])
    return diagnose.run()
