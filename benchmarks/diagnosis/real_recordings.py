"""What the diagnosis says of real recordings: the Husky on four grounds, and the F1TENTH car.

`python benchmarks/diagnosis/real_recordings.py` prints tables; HOMEWARD_DATA names the folder of recordings, else they
are downloaded.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.tables import span
from homeward import cli
from homeward.datasets import DatasetError, fetch
from homeward.diagnosis import Analysis, analyse

GROUNDS = ("FLOORING", "ASPHALT", "ICE", "SNOW")


@dataclass(frozen=True)
class Args:
    """What the diagnosis leaves to chance."""

    seed: int = 0
    """Seed of placebos and intervals."""


def main(args: Args) -> None:
    """Diagnose and print.

    Raises:
        DatasetError: The recordings cannot be had.
    """
    console = Console(width=170)
    runs = {ground: fetch("husky_borealtc", ground) for ground in GROUNDS}
    table = _table("Husky, motor current, held out by run")
    for ground in GROUNDS:
        _row(table, f"{ground}, {len(runs[ground])} runs", analyse(runs[ground], "husky", "husky_borealtc", args.seed))
    console.print(table)

    table = _table("F1TENTH car, battery power, held out by block")
    _row(table, "DS5", analyse(fetch("f1tenth_frictionmaps", ""), "f1tenth", "f1tenth_frictionmaps", args.seed))
    console.print(table)


def _table(title: str) -> Table:
    return Table(
        "recordings", "verdict", "missing, with size (95 %)", "RMSE nominal", "refit", "corrected", "file",
        "black box", "R^2 corrected", "range accuracy, nominal / refit / corrected / file", "file holds",
        "what is left", title=title,
    )  # fmt: skip


def _row(table: Table, name: str, analysis: Analysis) -> None:
    diagnosis, evidence = analysis.diagnosis, analysis.evidence
    assert diagnosis.fit is not None and evidence is not None
    arms = diagnosis.fit.arms
    named = []
    for one in diagnosis.missing_physics:
        size, value = next(iter(one.parameters.items()))
        named.append(f"{one.effect}: {size} {span(value.value, value.ci95, '.3g')} {value.unit}")
    errors = [
        f"{arms[arm].rmse:.3g}" if arm in arms else "-"
        for arm in ("nominal", "refit", "corrected", "file", "black_box")
    ]
    r2 = arms["corrected"].r2 if "corrected" in arms else None
    accuracy = [evidence.range_accuracy_pct.get(arm) for arm in ("nominal", "refit", "corrected", "file")]
    shown = " / ".join("-" if one is None else f"{one:.0f} %" for one in accuracy)
    left = "-"
    if evidence.remains is not None:
        formula = evidence.remains.formula
        left = evidence.remains.location.condition
        left += f": {formula.text}, {formula.held_out_gain:.0%} of it" if formula is not None else ""
    fit = "-" if r2 is None else f"{r2:.2f}"
    holds = "-" if diagnosis.file is None else diagnosis.file.holds
    table.add_row(name, diagnosis.verdict, "\n".join(named), *errors, fit, shown, holds, left)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (DatasetError,)))
