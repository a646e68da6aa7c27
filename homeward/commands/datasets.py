"""List public recordings of real robots, or fetch one.

`homeward datasets` lists them. `homeward datasets husky_borealtc/FLOORING` downloads the recordings
of a group into the user's cache, verifies their checksums and prints their paths; without /FLOORING
all groups. HOMEWARD_DATA=FOLDER uses a folder instead of the network.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro
from rich import box
from rich.table import Table

from homeward import cli
from homeward.datasets import DATASETS, DatasetError, fetch, files_of, groups_of


@dataclass(frozen=True)
class Args:
    """Data set."""

    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[NAME]")] = None
    """Data set to fetch, or NAME/GROUP for a part of it; by default a table of all is printed."""


def main(args: Args) -> None:
    """Print the table, or fetch and print paths.

    Raises:
        DatasetError: The data set does not exist or is not available.
    """
    if args.name is not None:
        name, _, group = args.name.partition("/")
        for path in fetch(name, group):
            print(path)
        return
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("data set", "robot", "files", "groups", "licence"):
        side: Literal["left", "right"] = "right" if heading == "files" else "left"
        table.add_column(heading, justify=side, overflow="fold", no_wrap=heading == "data set")
    for name, dataset in DATASETS.items():
        groups = "\n".join(groups_of(name))
        table.add_row(name, dataset.robot or "", str(len(files_of(name))), groups, dataset.licence)
    cli.Terminal().print(table)


def run() -> int:
    """Run from the command line: 3 if a download fails, otherwise see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (DatasetError,))
