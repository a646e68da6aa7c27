"""Differences of groups beside the spread of their runs: which of the large ones are named.

`python -m benchmarks.groups groups.json` reads comparisons that `homeward diagnose --group` wrote.
Of every pair and quantity it computes, apart from the tool, the difference of the means over the
standard deviation between runs, pooled over the two groups, and prints the pairs above three of
them and all others that are named. Runs dealt to the groups at random say how often the test names
a pair where nothing differs.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from homeward.groups.comparison import SCHEMA, Quantity, compare
from homeward.logs.channels import Array

SPREADS = 3.0
"""Difference of two groups over the spread of runs that the test should name."""


@dataclass(frozen=True)
class Args:
    """What to read."""

    comparisons: tyro.conf.Positional[tuple[Path, ...]]
    """Files groups.json."""
    shuffles: int = 0
    """Times that the runs of a file are dealt to its groups at random."""


@dataclass(frozen=True)
class Pair:
    """Two groups by one quantity."""

    groups: str
    quantity: str
    difference: float  # of the means, in the unit of the quantity
    spreads: float  # over the standard deviation between runs, pooled over both groups
    p_fdr: float | None  # None where the tool does not compare the pair
    named: bool


def pairs_of(comparison: dict[str, Any]) -> list[Pair]:
    """Every pair of groups with two runs or more, by every quantity that the tool compares."""
    by_pair = {
        (difference["quantity"], frozenset((difference["group"], difference["minus"]))): difference
        for difference in comparison["differences"]
    }
    groups = list(dict.fromkeys(run["group"] for run in comparison["runs"]))
    quantities = dict.fromkeys(level["quantity"] for level in comparison["levels"])
    pairs = []
    for quantity in quantities:
        runs_of = {group: _values(comparison, quantity, group) for group in groups}
        runs_of = {group: values for group, values in runs_of.items() if len(values) > 1}
        for minus, group in combinations(runs_of, 2):
            freedom = [len(runs_of[name]) - 1 for name in (minus, group)]
            variances = [float(np.var(runs_of[name], ddof=1)) for name in (minus, group)]
            spread = float(np.sqrt(np.average(variances, weights=freedom)))
            difference = float(runs_of[group].mean() - runs_of[minus].mean())
            compared = by_pair.get((quantity, frozenset((group, minus))))
            pairs.append(
                Pair(
                    groups=f"{group} - {minus}",
                    quantity=quantity,
                    difference=difference,
                    spreads=_in_spreads(difference, spread),
                    p_fdr=None if compared is None else compared["p_fdr"],
                    named=compared is not None and compared["named"],
                )
            )
    return sorted(pairs, key=lambda pair: -pair.spreads)


def _in_spreads(difference: float, spread: float) -> float:
    """A difference over the spread of runs; infinite where runs do not differ and groups do."""
    if spread > 0.0:
        return abs(difference) / spread
    return np.inf if difference else 0.0


def _values(comparison: dict[str, Any], quantity: str, group: str) -> Array:
    """A quantity of the runs of a group that identify it, shape (runs,)."""
    values = [run["values"].get(quantity) for run in comparison["runs"] if run["group"] == group]
    return np.array([value for value in values if value is not None], np.float64)


def alarms_of(comparison: dict[str, Any], shuffles: int) -> int:
    """How often a pair is named where the runs are dealt to the groups at random."""
    labels = np.array([run["group"] for run in comparison["runs"]])
    units = {level["quantity"]: level["unit"] for level in comparison["levels"]}
    values = {
        Quantity(name, unit): np.array(
            [run["values"].get(name) for run in comparison["runs"]], np.float64
        )
        for name, unit in units.items()
    }
    rng = np.random.default_rng(0)
    alarms = 0
    for _ in range(shuffles):
        _, differences = compare(rng.permutation(labels).tolist(), values)
        alarms += any(difference.named for difference in differences)
    return alarms


def show(pairs: Sequence[Pair], console: Console) -> None:
    """Print how many large differences are named, those pairs, and all others that are named."""
    large = [pair for pair in pairs if pair.spreads > SPREADS]
    named = sum(pair.named for pair in large)
    console.print(f"named: {named} of {len(large)} above {SPREADS:g} spreads")
    table = Table()
    for head in ("pair", "quantity", "difference", "spreads", "p, FDR", "named"):
        table.add_column(head)
    for pair in pairs:
        if pair.named or pair.spreads > SPREADS:
            p_fdr = "not compared" if pair.p_fdr is None else f"{pair.p_fdr:.2g}"
            table.add_row(
                pair.groups,
                pair.quantity,
                f"{pair.difference:.3g}",
                f"{pair.spreads:.1f}",
                p_fdr,
                "yes" if pair.named else "no",
            )
    console.print(table)


def main(args: Args) -> None:
    """Print the pairs of each comparison."""
    console = Console()
    for path in args.comparisons:
        comparison = json.loads(path.read_text())
        if comparison.get("schema") != SCHEMA:
            sys.exit(
                f"{path} has format {comparison.get('schema')}, and {SCHEMA} is read: compare the groups again"
            )
        console.print(f"{path}:")
        show(pairs_of(comparison), console)
        if args.shuffles:
            alarms = alarms_of(comparison, args.shuffles)
            console.print(f"runs dealt at random: a pair is named in {alarms} of {args.shuffles}")


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
