"""The command `homeward`, also as `python -m homeward`: finds the subcommand and loads only what it
needs."""

from __future__ import annotations

import difflib
import importlib
import sys

from homeward import __version__

COMMANDS = {
    "range": ("ROBOT", "range of a robot on one charge, and the energy by cause"),
    "train": ("--out DIR", "train a policy with PPO"),
    "sweep": ("--seeds 0 1 2", "train over seeds and settings, also on a Ray cluster"),
    "evaluate": ("--agents NAME ...", "compare agents on the same episodes"),
    "diagnose": ("RUN ...", "find which physics a simulator lacks, from recordings of the robot"),
    "watch": (
        "RUN ... --robot ROBOT",
        "replay recordings as if live, or advise a robot on its ROS 2 network",
    ),
    "columns": ("RUN", "propose which columns of a recording are which channels"),
    "fleet": ("FOLDER", "diagnose every robot of a fleet, also on a Ray cluster"),
    "robots": ("[ROBOT]", "list the shipped robots, or print the file of one"),
    "routes": ("[ROUTE]", "list routes, or measure and draw one, also your own GPX track"),
    "datasets": ("[NAME]", "list public recordings, or fetch one"),
}
"""Arguments and purpose of each subcommand; each is a module of `homeward.commands`."""

_HELP = """\
homeward {version}: ground robots that must get home on one battery charge.

{commands}

First steps:
  homeward range rusti --grade 5.71 --duty 0.367 --plot range.png
  homeward evaluate --env homeward/Survey-v0 --episodes 100 --out runs/first
  homeward diagnose --out runs/diagnosis

homeward COMMAND --help lists all options of a command. Exit codes: 0 done, 2 unusable input or output, with one line
that says why, 3 a failed download, 130 after Ctrl-C.
"""


def usage() -> str:
    """The text of `homeward --help`."""
    lines = [
        f"  homeward {name} {arguments:<{28 - len(name)}}{does}"
        for name, (arguments, does) in COMMANDS.items()
    ]
    return _HELP.format(version=__version__, commands="\n".join(lines))


def run() -> int:
    """Run the subcommand that the command line names.

    Returns:
        Exit code, see `homeward.cli.run`; 2 for an unknown subcommand.
    """
    name = "--help"
    if len(sys.argv) > 1:
        name = sys.argv[1]
    if name in ("-h", "--help", "help"):
        print(usage(), end="")
        return 0
    if name == "--version":
        print(f"homeward {__version__}")
        return 0
    if name not in COMMANDS:
        hint = ""
        close = difflib.get_close_matches(name, COMMANDS, n=1)
        if close:
            hint = f" (did you mean {close[0]!r}?)"
        print(
            f"homeward: unknown command {name!r}{hint}; commands: {', '.join(COMMANDS)}",
            file=sys.stderr,
        )
        return 2
    code: int = importlib.import_module(f"homeward.commands.{name}").run()
    return code


if __name__ == "__main__":
    sys.exit(run())
