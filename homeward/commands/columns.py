"""Propose which columns of a foreign recording are which channels.

`homeward columns RUN.csv` says what each column is taken for, with what factor, and how sure that is.
`--out my_columns.toml` writes it as a mapping file, for `homeward diagnose RUN.csv --columns my_columns.toml`; check it
before, above all signs and guesses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.table import Table

from homeward import cli
from homeward.diagnosis.read.columns import Columns, RecordingError, Source
from homeward.diagnosis.read.propose import SURE, Proposal, propose
from homeward.diagnosis.read.recordings import read_recording
from homeward.files import write_whole


@dataclass(frozen=True)
class Args:
    """Whose columns, and where to write the mapping."""

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Recording: a .csv, .csv.gz, .tsv, .txt or .parquet file."""
    out: Path | None = None
    """Mapping file to write (.toml); none: it is only shown."""


def main(args: Args) -> Proposal:
    """Print the proposal, try it, and write it if asked to.

    Raises:
        RecordingError: The file cannot be read, or no column of it looks like a channel.
        OSError: The mapping cannot be written.
    """
    if args.out is not None and (args.out.suffix != ".toml" or args.out.exists()):
        raise RecordingError(f"--out {args.out}: give a new file that ends in .toml; one that is there is not replaced")
    proposal = propose(args.run)
    if not proposal.guesses:
        names = ", ".join(list(proposal.left_over)[:12])
        raise RecordingError(f"{args.run}: no column looks like a channel; it has {names}: write a mapping by hand")
    console = cli.Terminal()
    console.print(_table(proposal))
    if proposal.notes:
        console.print(f"Read with {', '.join(proposal.notes)}.")
    if proposal.left_over:
        console.print(f"Not used: {', '.join(name + why * bool(why) for name, why in proposal.left_over.items())}")
    tried, reads = _tried(proposal)
    console.print(tried)
    if args.out is None:
        console.print(f"Write it with --out my_columns.toml:\n\n{proposal.toml()}", soft_wrap=True)
    else:
        write_whole(args.out, proposal.toml())
        todo = "Check it" if reads else "Add what is missing"
        console.print(f"Written to {args.out}. {todo}, then: homeward diagnose {args.run} --columns {args.out}",
                      soft_wrap=True)  # fmt: skip
    return proposal


def _table(proposal: Proposal) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("column", "channel", "factor", "how sure", "why"):
        table.add_column(heading, justify="right" if heading == "factor" else "left", overflow="fold",
                         no_wrap=heading in ("channel", "factor", "how sure"))  # fmt: skip
    for one in proposal.guesses:
        factor = f"{one.factor:.4g}" + (f", {one.offset:+g}" if one.offset else "")
        table.add_row(one.column, one.channel, factor, SURE[one.sure], one.why)
    return table


def _tried(proposal: Proposal) -> tuple[str, bool]:
    """What reading the file with the proposal says, and whether it can be read."""
    sources = {one.channel: Source(((one.column, one.factor),), one.offset) for one in proposal.guesses}
    try:
        recording = read_recording(proposal.path, Columns("proposed", sources, {}))
    except RecordingError as error:
        return f"With it the file cannot be read yet: {error}", False
    return f"With it the file reads: {len(recording)} samples over {recording.duration_s:.4g} s.", True


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RecordingError,))
