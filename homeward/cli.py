"""How the scripts run from the command line, what they print, and how they end."""

from __future__ import annotations

import contextlib
import copy
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

Args = TypeVar("Args")

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal, as shells have it."""

_ANY_WIDTH = 10_000  # columns; chosen: wider than any table
_LONGEST = 2000
"""Characters of a message; what quotes a file may quote much of it. Chosen: a screen of a terminal (80 by 25)."""


class Terminal(Console):
    """A console that prints text as it is: names given by others neither style it nor reach it as control characters.

    What is styled is given as `rich.text.Text`, made of what `printable` returns.
    """

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)

    def show(self, table: Table, expendable: Sequence[str] = ()) -> None:
        """Print a table of figures; where the terminal is too narrow, columns are left out and a line names them.

        Args:
            table: The table; columns are taken from it. Where the output is no terminal it gets the width it wants.
            expendable: Headings of columns that may be left out, the least important first.
        """
        wide = not self.is_terminal and "COLUMNS" not in os.environ
        left_out = []
        for heading in () if wide else expendable:
            if self._natural_width(table) <= self.width:
                break
            column = next(one for one in table.columns if one.header == heading)
            table.columns.remove(column)
            left_out.append(" ".join(heading.split()))
        self.print(table, width=max(self._natural_width(table), self.width) if wide else None, crop=not wide)
        if left_out:
            self.print(f"Left out in a terminal of {self.width} columns: {', '.join(left_out)}.")

    def _natural_width(self, table: Table) -> int:
        # The title and the caption wrap.
        bare = copy.copy(table)
        bare.title = bare.caption = None
        return Measurement.get(self, self.options.update(max_width=_ANY_WIDTH), bare).maximum

    def render_str(self, text: str, **options: Any) -> Text:
        """As `Console.render_str`, with a question mark for each control character but ends of lines."""
        return super().render_str("\n".join(map(printable, text.split("\n"))), **options)


def printable(text: str) -> str:
    """Text of one line with a question mark for each character that is none, such as an escape.

    >>> printable("husky\\x1b[31m")
    'husky?[31m'
    """
    return "".join(c if c.isprintable() else "?" for c in text)


def remark(source: str, text: str) -> None:
    """Say on stderr, in one line, what is to be said of a file."""
    print(printable(f"{source}: {text}"), file=sys.stderr)


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
    for argument in arguments:  # the parser of arguments shows those that it does not know as they are
        if any(unicodedata.category(character) == "Cc" for character in argument):
            _say(program, f"argument '{argument}' holds a control character: type it again, or rename the file")
            return 2
    pressed: list[int] = []
    try:
        with warnings.catch_warnings(), _ctrl_c_noted(pressed):
            warnings.showwarning = _say_warning
            main(tyro.cli(args, prog=program, args=arguments, description=description))
    except (Exception, KeyboardInterrupt) as error:
        if pressed or isinstance(error, KeyboardInterrupt):  # compiled code may make another error of it
            code, message = INTERRUPTED, f"interrupted: {interrupted}"
        elif isinstance(error, refused):
            code, message = getattr(error, "exit_code", 2), str(error)
        elif isinstance(error, OSError):
            code = 2
            message = f"cannot write {error.filename or 'the output'}: {error.strerror or error}; choose another --out"
        else:
            raise
    else:
        return 0
    _say(program, message)
    return code


@contextlib.contextmanager
def _ctrl_c_noted(pressed: list[int]) -> Iterator[None]:
    """Append to a list when Ctrl-C is pressed, which raises KeyboardInterrupt as ever."""
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _say(program: str, message: str) -> None:
    line = printable(" ".join(message.split()))
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 4 :]}"
    print(f"{program}: {line}", file=sys.stderr)


def _say_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    program, _arguments = _called()
    _say(program, f"warning: {message}")


def _called() -> tuple[str, list[str]]:
    """Name and arguments of what was called: a script, or a subcommand of `homeward`."""
    path, arguments = Path(sys.argv[0]), sys.argv[1:]
    if arguments and (path.stem == "homeward" or (path.parent.name, path.name) == ("homeward", "__main__.py")):
        return f"homeward {arguments[0]}", arguments[1:]
    return path.name, arguments
