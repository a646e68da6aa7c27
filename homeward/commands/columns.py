"""Propose which columns of a recording are which channels, or check a mapping.

`homeward columns RUN.csv` prints the proposed channel of each column, its factor, and how sure the
proposal is. `--out my_columns.toml` writes it as a mapping file, for
`homeward diagnose RUN.csv --columns my_columns.toml`. Check it first, above all signs and guesses:
`homeward columns RUN --columns my_columns.toml` prints the values of each channel.

Several tables of one run are named with a plus between them, and get a mapping each:
`homeward columns odom.csv+bat.csv --out odom.toml+bat.toml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich import box
from rich.table import Table

from homeward import cli
from homeward.files import write_whole
from homeward.logs.channels import CHANNELS
from homeward.logs.columns import Columns, RecordingError, Source
from homeward.logs.guess import SURE
from homeward.logs.joined import BETWEEN, tables_of_run
from homeward.logs.propose import Proposal, propose_each
from homeward.logs.recordings import Recording, read_recording


@dataclass(frozen=True)
class Args:
    """Recording and mapping."""

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Recording: a .csv, .csv.gz, .tsv, .txt or .parquet file, or several of one run (a.csv+b.csv);
    with --columns also a bag or a log of an autopilot."""
    columns: str | None = None
    """Mapping of columns or topics to check: shipped name or TOML file; by default one is
    proposed."""
    out: Path | None = None
    """Mapping file to write (.toml), one for each table (a.toml+b.toml); by default it is only
    printed."""


def main(args: Args) -> list[Proposal]:
    """Print the proposals, one for each table, try them, and write them if requested; or print the
    values of a mapping.

    Raises:
        RecordingError: A file cannot be read, or no column of it looks like a channel.
        OSError: A mapping cannot be written.
    """
    parts = tables_of_run(args.run)
    targets = _targets(args.out, len(parts))
    if args.columns is not None:
        if args.out is not None:
            raise RecordingError(
                "--columns checks a mapping and --out writes a proposed one; give one of them"
            )
        _check(read_recording(args.run, args.columns))
        return []
    proposals = propose_each(parts)
    console = cli.Terminal()
    for proposal in proposals:
        _show(proposal, console, with_name=len(proposals) > 1)
    trial_lines, reads = _tried(args.run, proposals)
    for line in trial_lines:
        console.print(line)
    if args.out is not None:
        for target, proposal in zip(targets, proposals, strict=True):
            write_whole(target, proposal.toml())
        todo = "Check it" if reads else "Add what is missing"
        console.print(f"Written to {args.out}. {todo}, then: homeward diagnose {args.run} --columns {args.out}",
                      soft_wrap=True)  # fmt: skip
    elif reads and all(proposal.needless for proposal in proposals):
        console.print("A mapping is not needed: all names and units are those of channels.")
    else:
        names = [f"{part.stem}.toml" for part in parts]
        if len(parts) == 1:
            names = ["my_columns.toml"]
        texts = "\n".join(proposal.toml() for proposal in proposals)
        console.print(f"Write it with --out {BETWEEN.join(names)}:\n\n{texts}", soft_wrap=True)
    return proposals


def _show(proposal: Proposal, console: cli.Terminal, *, with_name: bool) -> None:
    """Print a proposal; refuse one without a channel."""
    if not proposal.guesses:
        names = ", ".join(list(proposal.left_over)[:12])
        raise RecordingError(
            f"{proposal.path}: no column looks like a channel; it has {names}: write a mapping by hand"
        )
    if with_name:
        console.print(f"{proposal.path.name}:", soft_wrap=True)
    console.print(_table(proposal))
    if proposal.left_over:
        unused = ", ".join(name + why for name, why in proposal.left_over.items())
        console.print(f"Not used: {unused}")


def _targets(out: Path | None, tables: int) -> list[Path]:
    """Files to write, one for each table."""
    if out is None:
        return []
    targets = [out]
    if tables > 1:
        targets = [Path(name) for name in str(out).split(BETWEEN)]
    for target in targets:
        if target.suffix != ".toml" or target.exists():
            raise RecordingError(
                f"--out {target}: give a new file that ends in .toml; an existing one is not replaced"
            )
    if len(set(targets)) != tables:
        raise RecordingError(
            f"--out {out}: give a file for each of {tables} tables, such as a.toml{BETWEEN}b.toml"
        )
    return targets


def _check(recording: Recording) -> None:
    """Print the values of each channel beside its unit and sign."""
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("channel", "least", "median", "most", "known", "unit", "should be"):
        is_number = heading in ("least", "median", "most", "known")
        side: Literal["left", "right"] = "right" if is_number else "left"
        table.add_column(heading, justify=side, no_wrap=heading != "should be", overflow="fold")
    for name, values in recording.channels.items():
        finite = values[np.isfinite(values)]
        numbers = ["-", "-", "-"]
        if len(finite):
            numbers = [f"{value:.4g}" for value in np.quantile(finite, (0.0, 0.5, 1.0))]
        channel = CHANNELS[name]
        table.add_row(
            name, *numbers, f"{len(finite) / len(values):.0%}", channel.unit, channel.meaning
        )
    console = cli.Terminal()
    console.print(table)
    for note in recording.notes:
        console.print(note, soft_wrap=True)
    console.print(f"{len(recording)} samples over {recording.duration_s:.4g} s.")


def _table(proposal: Proposal) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("column", "channel", "factor", "how sure", "why"):
        side: Literal["left", "right"] = "right" if heading == "factor" else "left"
        no_wrap = heading in ("channel", "factor", "how sure")
        table.add_column(heading, justify=side, overflow="fold", no_wrap=no_wrap)
    for guess in proposal.guesses:
        factor = f"{guess.factor:.4g}"
        if guess.offset:
            factor += f", {guess.offset:+g}"
        name = " + ".join(filter(None, (guess.column, guess.and_column)))
        table.add_row(name, guess.channel, factor, SURE[guess.sure], guess.why)
    return table


def _tried(run: Path, proposals: list[Proposal]) -> tuple[list[str], bool]:
    """Messages of reading the file or files with the proposals, and whether they can be read."""
    mappings = [_mapping(proposal) for proposal in proposals]
    columns: Columns | list[Columns] = mappings
    if len(mappings) == 1:
        columns = mappings[0]
    try:
        recording = read_recording(run, columns)
    except RecordingError as error:
        notes = [
            f"read with {', '.join(proposal.notes)}" for proposal in proposals if proposal.notes
        ]
        return [*notes, f"With it the file cannot be read yet: {error}"], False
    reads = f"With it the file reads: {len(recording)} samples over {recording.duration_s:.4g} s."
    return [*recording.notes, reads], True


def _mapping(proposal: Proposal) -> Columns:
    sources = {}
    for guess in proposal.guesses:
        names = [name for name in (guess.column, guess.and_column) if name]
        sources[guess.channel] = Source(tuple((name, guess.factor) for name in names), guess.offset)
    return Columns("proposed", sources, {})


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RecordingError,))
