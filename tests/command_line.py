"""Commands and examples in this process: to start Python and load what they need takes longer than
what they do."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

import diagnose
from homeward import __main__ as command


def ended(words: list[str]) -> tuple[int, str, str]:
    """Exit code of `homeward WORDS`, what it printed and what it said."""
    return _ended(command.run, ["homeward", *words])


def example_ended(name: str, *words: str) -> tuple[int, str, str]:
    """Exit code of `python examples/NAME.py WORDS`, what it printed and what it said."""
    path = Path(__file__).parents[1] / "examples" / f"{name}.py"
    return _ended(lambda: runpy.run_path(str(path), run_name="__main__"), [str(path), *words])


def _ended(run: Callable[[], object], arguments: list[str]) -> tuple[int, str, str]:
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(pytest.MonkeyPatch.context()).setattr(sys, "argv", arguments)
        stack.enter_context(contextlib.redirect_stdout(printed))
        stack.enter_context(contextlib.redirect_stderr(said))
        stack.enter_context(warnings.catch_warnings(action="ignore"))
        code: object = 0
        try:
            result = run()
            if isinstance(result, int):
                code = result
        except SystemExit as end:  # as an example ends, or of a word that no option has
            code = end.code
    return int(str(code or 0)), printed.getvalue(), said.getvalue()


def diagnosed(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    """Exit code of `diagnose.py ARGUMENTS`."""
    monkeypatch.setattr(sys, "argv", ["diagnose.py", *map(str, arguments)])
    return diagnose.run()
