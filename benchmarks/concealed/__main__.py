"""Diagnose recordings with concealed physics, and count the correct diagnoses.

`python -m benchmarks.concealed --seed 1 --part all --cases 81 --workers 2 --out runs/concealed`
writes DIR/concealed.json (every outcome), DIR/concealed.md (the tables), and the outputs of the
diagnosis of each case.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from rich.markdown import Markdown

from benchmarks.concealed.plants.cases import NEEDS, PARTS, Part
from benchmarks.concealed.scoring.count import tables
from benchmarks.concealed.scoring.outcome import Outcome, run_case
from homeward.parallel import run_tasks


@dataclass(frozen=True)
class Args:
    """What to run."""

    seed: int = 1
    """Seed of all cases."""
    part: Literal[
        "singles", "pairs", "controls", "outside", "later", "coverage", "rover", "cell", "all"
    ] = "all"
    """Part of the benchmark; later: singles and pairs, of which half the cases are each; all: those
    installed."""
    cases: int = 81
    """Cases of each part. Every kind occurs once in 81 singles, 27 pairs, 30 controls, 17 outside,
    16 of coverage, 85 of the rover and 51 of the cell."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/concealed")
    """Folder for concealed.json, concealed.md and the diagnoses."""
    without: tuple[str, ...] = ()
    """Conditions under which an effect is named that are left out, to see what they are worth."""


def main(args: Args) -> list[Outcome]:
    """Make the cases, diagnose them, print and write the tables."""
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")  # it would ask on the terminal
    args.out.mkdir(parents=True, exist_ok=True)
    tasks = {
        f"{part} {number}": (part, args.seed, number, args.out, args.without)
        for part, number in _wanted(args)
    }
    if not tasks:
        sys.exit(1)
    start_s = time.perf_counter()
    outcomes = list(
        run_tasks(lambda task: run_case(*task), tasks, jobs=args.workers, title="cases").values()
    )
    text = "\n".join(table.markdown() for table in tables(outcomes))
    console = Console()
    console.width = max(console.width, 170)  # a log file has no width of its own
    console.print(Markdown(text))
    written = {
        "seed": args.seed, "part": args.part, "cases": args.cases, "seconds": time.perf_counter() - start_s,
        "outcomes": [dataclasses.asdict(outcome) for outcome in outcomes],
    }  # fmt: skip
    (args.out / "concealed.json").write_text(json.dumps(written, indent=1))
    (args.out / "concealed.md").write_text(text)
    return outcomes


def _wanted(args: Args) -> list[tuple[Part, int]]:
    if args.part == "later":
        half = (args.cases + 1) // 2
        return [("singles", n) for n in range(half)] + [
            ("pairs", n) for n in range(args.cases - half)
        ]
    parts = PARTS if args.part == "all" else (args.part,)
    missing = [part for part in parts if part in NEEDS and find_spec(NEEDS[part]) is None]
    if missing:
        print(f"Left out: {', '.join(missing)}. Install with pip install -e '.[concealed]' -c constraints.txt",
              file=sys.stderr)  # fmt: skip
    return [(part, number) for part in parts if part not in missing for number in range(args.cases)]


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
