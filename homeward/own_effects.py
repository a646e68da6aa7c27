"""A Python file with an effect of one's own: named by --effects or HOMEWARD_EFFECTS, never by what
is read.

It is set before the physics is imported, because kernels are made of all effects. Processes that a
command starts inherit the variable. Needs only Python itself.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from homeward import loading

VARIABLE = "HOMEWARD_EFFECTS"
_OPTION = "--effects"
REMEDY = (
    f"an effect of your own needs {_OPTION} FILE.py (diagnose) or {VARIABLE}=FILE.py (all commands)"
)


def own_file() -> Path | None:
    """The file, None if none is named."""
    name = os.environ.get(VARIABLE)
    if not name:
        return None
    return Path(name)


def _take_from_command_line() -> None:
    """Set the variable by the option of a command of this project."""
    if loading.program() is None:
        return
    for place, argument in enumerate(sys.argv[1:], 1):
        name, _, value = argument.partition("=")
        if name != _OPTION:
            continue
        file = value or next(iter(sys.argv[place + 1 :]), "")
        os.environ[VARIABLE] = ""
        if file:
            os.environ[VARIABLE] = str(Path(file).absolute())


_take_from_command_line()
