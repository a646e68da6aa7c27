"""Recordings with concealed physics, the tool's answers, and how many of them are right.

`python -m benchmarks.concealed --seed 1 --part all --cases 78 --workers 2 --out runs/concealed` writes
DIR/concealed.json (every outcome) and DIR/concealed.md (the tables), and keeps what the tool wrote a case.
"""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as RichTable

from benchmarks.concealed.plants.cases import NEEDS, PARTS, Part
from benchmarks.concealed.scoring.count import Table, tables
from benchmarks.concealed.scoring.outcome import Outcome, run_case


@dataclass(frozen=True)
class Args:
    """What to run."""

    seed: int = 1
    """Seed of all cases."""
    part: Literal["singles", "pairs", "controls", "outside", "later", "coverage", "rover", "cell", "all"] = "all"
    """Part of the benchmark; later: singles and pairs, of which half the cases are each; all: those installed."""
    cases: int = 78
    """Cases a part. Every kind comes once in 78 singles, 26 pairs, 30 controls, 17 outside, 16 of coverage, 85 of the
    rover and 51 of the cell."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/concealed")
    """Folder for concealed.json, concealed.md and what the tool wrote."""


def main(args: Args) -> list[Outcome]:
    """Make the cases, ask the tool, print and write the tables."""
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")  # it would ask on the terminal
    args.out.mkdir(parents=True, exist_ok=True)
    jobs = [(part, args.seed, number, args.out) for part, number in _wanted(args)]
    outcomes = []
    console = Console()
    console.width = max(console.width, 170)  # a log file has no width of its own
    if not jobs:
        sys.exit(1)
    start_s = time.perf_counter()
    columns = (TextColumn("cases"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("cases", total=len(jobs))
        for outcome in _answers(jobs, args.workers):
            outcomes.append(outcome)
            bar.advance(task)
    outcomes.sort(key=lambda outcome: (PARTS.index(outcome.part), outcome.number))
    made = tables(outcomes)
    for table in made:
        console.print(_rich(table))
    written = {
        "seed": args.seed, "part": args.part, "cases": args.cases, "seconds": time.perf_counter() - start_s,
        "outcomes": [dataclasses.asdict(outcome) for outcome in outcomes],
    }  # fmt: skip
    (args.out / "concealed.json").write_text(json.dumps(written, indent=1))
    (args.out / "concealed.md").write_text("\n".join(table.markdown() for table in made))
    return outcomes


def _wanted(args: Args) -> list[tuple[Part, int]]:
    if args.part == "later":
        half = (args.cases + 1) // 2
        return [("singles", n) for n in range(half)] + [("pairs", n) for n in range(args.cases - half)]
    parts = PARTS if args.part == "all" else (args.part,)
    missing = [part for part in parts if part in NEEDS and find_spec(NEEDS[part]) is None]
    if missing:
        print(f"Left out: {', '.join(missing)}. Install with pip install -e '.[concealed]' -c constraints.txt",
              file=sys.stderr)  # fmt: skip
    return [(part, number) for part in parts if part not in missing for number in range(args.cases)]


def _answers(jobs: list[tuple[Part, int, int, Path]], workers: int) -> Iterator[Outcome]:
    if workers == 1:
        yield from (run_case(*job) for job in jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(run_case, *job) for job in jobs]):
            yield done.result()


def _rich(table: Table) -> RichTable:
    rich = RichTable(title=table.title)
    for name in table.columns:
        rich.add_column(name, overflow="fold")
    for row in table.rows:
        rich.add_row(*row)
    return rich


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
