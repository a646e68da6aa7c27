"""Common behaviour of the scripts on the command line: arguments, output and exit codes."""

from __future__ import annotations

import contextlib
import copy
import io
import os
import signal
import sys
import threading
import unicodedata
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import tyro
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from homeward.loading import INTERRUPTED, end_at_once

Args = TypeVar("Args")

_ANY_WIDTH = 10_000  # columns; chosen: wider than any table
_LONGEST = 2000
"""Maximum length of a message, which may quote a long part of a file. Chosen: a screen of a
terminal (80 by 25)."""


class Terminal(Console):
    """A console that prints text literally: names from files cannot style it or contain control
    characters.

    Styled text is given as `rich.text.Text`, made of what `printable` returns.
    """

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)

    def show(self, table: Table, expendable: Sequence[str] = ()) -> None:
        """Print a table; if the terminal is too narrow, columns are omitted and a line names them.

        Args:
            table: The table; columns are removed from it. If the output is not a terminal it gets
                its full width.
            expendable: Headings of columns that may be omitted, the least important first; the
                table may lack some.
        """
        is_file = not self.is_terminal and "COLUMNS" not in os.environ
        if is_file:
            self._print_whole(table)
            return
        left_out = []
        for heading in expendable:
            if self._natural_width(table) <= self.width:
                break
            unneeded = [column for column in table.columns if column.header == heading]
            for column in unneeded:
                table.columns.remove(column)
                left_out.append(" ".join(heading.split()))
        self.print(table)
        if left_out:
            self.print(f"Left out in a terminal of {self.width} columns: {', '.join(left_out)}.")

    def _print_whole(self, table: Table) -> None:
        usual = self.width
        # `print` takes no width above that of the console
        self.width = max(self._natural_width(table), usual)
        self.print(table)
        self.width = usual

    def _natural_width(self, table: Table) -> int:
        # The title and the caption wrap.
        bare = copy.copy(table)
        bare.title = bare.caption = None
        return Measurement.get(self, self.options.update(max_width=_ANY_WIDTH), bare).maximum

    def render_str(self, text: str, **options: Any) -> Text:
        """As `Console.render_str`, with a question mark for each control character but ends of
        lines."""
        return super().render_str("\n".join(map(printable, text.split("\n"))), **options)


def printable(text: str) -> str:
    """Text in one line with a question mark for each unprintable character, such as an escape.

    >>> printable("husky\\x1b[31m")
    'husky?[31m'
    """
    return "".join(sign if sign.isprintable() else "?" for sign in text)


def remark(source: str, text: str) -> None:
    """Print a message about a file on stderr, in one line."""
    print(printable(f"{source}: {text}"), file=sys.stderr)


def run(
    main: Callable[[Args], Any],
    args: Callable[..., Args],
    description: str | None,
    refused: tuple[type[Exception], ...],
    interrupted: str = "nothing half-written is left",
) -> int:
    """Run the `main` of a script or a subcommand of `homeward` with the arguments of the command
    line.

    Args:
        main: Does the work; its return value is ignored.
        args: Dataclass of the arguments.
        description: Shown by `--help`.
        refused: Exceptions with a one-line message that says what cannot be used and what to do.
        interrupted: Message after Ctrl-C.

    Returns:
        Exit code: 0; 130 after Ctrl-C; 2 for unusable input or output, or the error's own
        `exit_code`. All but 0 come with one line on stderr.
    """
    for stream in (sys.stdout, sys.stderr):
        # a terminal that lacks a sign shows a question mark
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    program, arguments = _called()
    for argument in arguments:  # the parser prints unknown arguments literally
        if _has_control_character(argument):
            _say(
                program,
                f"argument '{argument}' holds a control character: type it again, or rename the file",
            )
            return 2
    pressed: list[int] = []
    try:
        with warnings.catch_warnings(), _ctrl_c_noted(pressed):
            warnings.showwarning = _say_warning
            main(tyro.cli(args, prog=program, args=arguments, description=description))
    except (Exception, KeyboardInterrupt) as error:
        # compiled code may turn it into another error
        if pressed or isinstance(error, KeyboardInterrupt):
            _say(program, f"interrupted: {interrupted}")
            return INTERRUPTED
        if isinstance(error, refused):
            _say(program, str(error))
            return int(getattr(error, "exit_code", 2))
        if isinstance(error, OSError):
            file = error.filename or "the output"
            _say(program, f"cannot write {file}: {error.strerror or error}; choose another --out")
            return 2
        raise
    return 0


def _has_control_character(text: str) -> bool:
    return any(unicodedata.category(character) == "Cc" for character in text)


@contextlib.contextmanager
def _ctrl_c_noted(pressed: list[int]) -> Iterator[None]:
    """Append to a list when Ctrl-C is pressed, which still raises KeyboardInterrupt."""
    handler = signal.getsignal(signal.SIGINT)
    ends = handler in (signal.default_int_handler, end_at_once)
    if not ends or threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


def _say(program: str, message: str) -> None:
    line = printable(" ".join(message.split()))
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 4 :]}"
    print(f"{program}: {line}", file=sys.stderr)


def _say_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    program, _arguments = _called()
    _say(program, f"warning: {message}")


def _called() -> tuple[str, list[str]]:
    """Name and arguments of the called script or subcommand of `homeward`."""
    path = Path(sys.argv[0])
    arguments = sys.argv[1:]
    is_main_module = path.parent.name == "homeward" and path.name == "__main__.py"
    if arguments and (path.stem == "homeward" or is_main_module):
        return f"homeward {arguments[0]}", arguments[1:]
    return path.name, arguments
