"""Does the diagnosis find what is hidden? Effects concealed in recordings, diagnosed without the truth, then scored.

`python benchmarks/concealed.py` writes recordings and robot files into OUT/seen and what is hidden in them into
OUT/truth, diagnoses every case from OUT/seen in processes that cannot open OUT/truth, and only then scores.
OUT/score.json holds the score; its tables and the confusion matrix go to docs/concealed.md and docs/concealed.png, or,
where only a part of the cases was asked for, into OUT.
"""

from __future__ import annotations

import heapq
import importlib
import inspect
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import blake2b
from itertools import chain
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

from benchmarks.plants.case import Case, write
from benchmarks.scoring.outcome import read_outcome
from benchmarks.scoring.plot import draw_confusion
from benchmarks.scoring.score import confusion
from benchmarks.scoring.table import as_data, grids
from benchmarks.scoring.work import diagnose_all, is_done
from homeward import cli
from homeward.files import write_whole

Source = Literal["rover", "cell", "plant"]
SOURCES: tuple[Source, ...] = ("rover", "cell", "plant")

DOCS = Path(__file__).parents[1] / "docs"


class SourceError(Exception):
    """A source of cases that cannot be used."""


@dataclass(frozen=True)
class Args:
    """Which cases, and where to."""

    only: Source | None = None
    """Source of the cases: a rover in MuJoCo, a cell in PyBaMM, a plant written apart; all of them if left out."""
    cases: int | None = None
    """Number of cases to draw at random; all of them if left out."""
    seed: int = 0
    """Seed of what is drawn, and of sources that take one."""
    jobs: int = 2
    """Processes that diagnose."""
    out: Path = Path("runs/concealed")
    """Folder for recordings, truth, verdicts and score."""
    resume: bool = False
    """Keep what an interrupted run has already diagnosed, and the cases that it wrote."""


def main(args: Args) -> None:
    """Write the cases, diagnose and score them.

    Raises:
        SourceError: A source of cases cannot be used, or there is nothing to resume.
        OSError: A folder cannot be written to.
    """
    if args.jobs < 1 or (args.cases is not None and args.cases < 1):
        raise SourceError(f"--jobs {args.jobs} and --cases {args.cases} must be at least 1")
    names = _resumed(args) if args.resume and _list(args).exists() else write_cases(args)
    todo = [name for name in names if not is_done(args.out, name)]
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("diagnosing", total=len(names), completed=len(names) - len(todo))
        diagnose_all(args.out, todo, args.jobs, lambda: bar.advance(task))
    report(args, names)


def write_cases(args: Args) -> list[str]:
    """Write the chosen cases and, when all are there, the list of their names; what was diagnosed before is dropped."""
    _list(args).unlink(missing_ok=True)
    every = chain.from_iterable(_generate(source, args.seed) for source in _sources(args))
    chosen = every if args.cases is None else heapq.nsmallest(args.cases, every, key=lambda case: _lot(case, args.seed))
    names = []
    with Progress(TextColumn("writing cases"), TextColumn("{task.completed}"), TimeElapsedColumn(),
                  console=Console(stderr=True)) as bar:  # fmt: skip
        task = bar.add_task("", total=None)
        for case in chosen:
            write(case, args.out / "seen", args.out / "truth")
            names.append(case.name)
            bar.advance(task)
    names.sort()  # by their names, which say nothing: not in the order in which effects were hidden
    for name in names:
        (args.out / "aside" / f"{name}.json").unlink(missing_ok=True)
    write_whole(_list(args), json.dumps({**_asked(args), "names": names}, indent=1) + "\n")
    return names


def _sources(args: Args) -> tuple[Source, ...]:
    return SOURCES if args.only is None else (args.only,)


def _generate(source: Source, seed: int) -> Iterator[Case]:
    try:
        module = importlib.import_module(f"benchmarks.plants.{source}")
    except ImportError as error:
        raise SourceError(f"{source}: {error}; install what is missing or choose another source by --only") from error
    takes_seed = "seed" in inspect.signature(module.cases).parameters
    yield from module.cases(seed=seed) if takes_seed else module.cases()


def _lot(case: Case, seed: int) -> str:
    return blake2b(f"{seed} {case.name}".encode()).hexdigest()


def _list(args: Args) -> Path:
    return args.out / "cases.json"


def _asked(args: Args) -> dict[str, object]:
    return {"sources": list(_sources(args)), "cases": args.cases, "seed": args.seed}


def _resumed(args: Args) -> list[str]:
    listed = json.loads(_list(args).read_text(encoding="utf-8"))
    names = [str(name) for name in listed.pop("names")]
    if listed != _asked(args):
        raise SourceError(f"{_list(args)} lists other cases ({listed}); leave out --resume or choose another --out")
    return names


def report(args: Args, names: list[str]) -> None:
    """Open the truth, print the tables and write score.json, concealed.md and concealed.png."""
    outcomes = [read_outcome(args.out, name) for name in names]
    tables, console = grids(outcomes), Console()
    for table in tables:
        console.print(table.rich())
    write_whole(args.out / "score.json", json.dumps(as_data(outcomes), indent=1) + "\n")
    whole = args.only is None and args.cases is None
    folder = DOCS if whole else args.out
    draw_confusion(confusion(outcomes), folder / "concealed.png")
    page = "\n".join((_introduction(len(outcomes), args), *(table.markdown() for table in tables)))
    write_whole(folder / "concealed.md", page)
    console.print(f"{folder / 'concealed.md'}, {folder / 'concealed.png'}, {args.out / 'score.json'}", highlight=False)


def _introduction(cases: int, args: Args) -> str:
    return f"""# Concealed cases

{cases} cases from {", ".join(_sources(args))} (seed {args.seed}): recordings in which an effect is hidden, or
nothing is. The diagnosis gets the recordings and a nominal robot file. What is hidden lies in another folder, which
only the scorer opens. Written by `python benchmarks/concealed.py`.

A class is the effect that is named and those that the tool says it may be confused with; its mean size stands beside
it. A pair is found when each of its effects is held by the class of another named effect. F1 is the overlap of
the time that the tool locates with the time at which the hidden effect was at work. The error fell when the held-out
error in excess of the noise is halved by the correction, or is within 10 % of the noise. Intervals are Wilson's, at
95 %. A case that crashed counts as failed.

![What is hidden against what is named first](concealed.png)
"""


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (SourceError,), "go on with --resume"))
