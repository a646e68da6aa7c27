"""The command `homeward`, also as `python -m homeward`: finds the subcommand and loads only what that needs."""

from __future__ import annotations

import difflib
import importlib
import sys

from homeward import __version__

COMMANDS = {
    "range": ("ROBOT", "how far a robot gets on one charge, and where the energy goes"),
    "train": ("--out DIR", "train a policy with PPO"),
    "sweep": ("--seeds 0 1 2", "train over seeds and settings, also on a Ray cluster"),
    "evaluate": ("--agents NAME ...", "compare agents on the same episodes"),
    "diagnose": ("RUN ...", "say which physics a simulator lacks, from recordings of the robot"),
    "watch": (
        "RUN ... --robot ROBOT",
        "replay recordings as if live, or advise a robot on its ROS 2 network",
    ),
    "columns": ("RUN", "propose which columns of a foreign recording are which channels"),
    "fleet": ("FOLDER", "diagnose every robot of a fleet, also on a Ray cluster"),
    "robots": ("[ROBOT]", "list the robots that ship, or print the file of one"),
    "routes": ("[ROUTE]", "list routes, or measure and draw one, also your own GPX track"),
    "datasets": ("[NAME]", "list public recordings, or fetch one"),
}
"""Arguments and purpose of each subcommand; each is a module of `homeward.commands`."""

_HELP = """\
homeward {version}: ground robots that must get home on one battery charge.

{commands}

To begin with:
  homeward range rusti --grade 5.71 --duty 0.367 --plot range.png
  homeward evaluate --env homeward/Survey-v0 --episodes 100 --out runs/first
  homeward diagnose --out runs/diagnosis

homeward COMMAND --help tells all options of a command. Exit codes: 0 well, 2 input or output that cannot be used, with
one line that says why, 3 a download that failed, 130 after Ctrl-C.
"""


def usage() -> str:
    """What `homeward --help` prints."""
    lines = [f"  homeward {name} {arguments:<{28 - len(name)}}{does}" for name, (arguments, does) in COMMANDS.items()]
    return _HELP.format(version=__version__, commands="\n".join(lines))


def run() -> int:
    """Run the subcommand that the command line names.

    Returns:
        Exit code, see `homeward.cli.run`; 2 for a subcommand that there is not.
    """
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if name in ("-h", "--help", "help"):
        print(usage(), end="")
        return 0
    if name == "--version":
        print(f"homeward {__version__}")
        return 0
    if name not in COMMANDS:
        close = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        print(f"homeward: unknown command {name!r}{hint}; commands: {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    code: int = importlib.import_module(f"homeward.commands.{name}").run()
    return code


if __name__ == "__main__":
    sys.exit(run())
