"""What each condition for a name is worth: the candidates that it alone refuses.

`HOMEWARD_DATA=FOLDER python -m benchmarks.conditions --sets husky v9 leaf f1tenth eco` diagnoses
the parts of `benchmarks.real_drives`; `--sets --seed 413 --cases 17` so many cases of each part of
a seed of `benchmarks.concealed`. Every candidate, and all named effects together, are checked
against all conditions, not only up to the first that fails. A condition that refuses nothing alone
changes no name if it is left out.
"""

from __future__ import annotations

import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import tyro
from joblib import Parallel, delayed
from rich.console import Console
from rich.table import Table

from benchmarks.concealed.plants.cases import PARTS, Part
from benchmarks.concealed.plants.draw import make_case
from benchmarks.real_drives import Set, Split, at_hand
from homeward.diagnosis import RecordingError, analyse
from homeward.diagnosis.explain import explanation, naming
from homeward.diagnosis.explain.candidate import Candidate
from homeward.diagnosis.explain.conditions import CONDITIONS, TOGETHER, Condition, judge
from homeward.diagnosis.explain.together import Together
from homeward.diagnosis.result import Checked

NAMES = (*(condition.name for condition in CONDITIONS), *(condition.name for condition in TOGETHER))

Judged = tuple[str, tuple[Checked, ...]]
"""Who was judged, and the values of all conditions."""


@dataclass(frozen=True)
class Args:
    """What to run."""

    sets: tuple[Set, ...] = ("husky", "v9", "leaf", "f1tenth", "eco")
    """Vehicles."""
    seed: int | None = None
    """Seed of simulated cases that nobody is to be surprised by any more."""
    cases: int = 17
    """Simulated cases of each part."""
    jobs: int = 2
    """Processes."""


def tried(diagnosed: Callable[[], object], whose: str) -> list[Judged]:
    """Every candidate of a diagnosis and all named effects together, with the values of all
    conditions."""
    judged: list[Judged] = []

    def candidate_to_the_end(
        candidate: Candidate, without: Collection[str], conditions: Sequence[Condition[Candidate]]
    ) -> tuple[Checked, ...]:
        judged.append((f"{whose}, {candidate.term.effect}", judge(candidate, NAMES, CONDITIONS)))
        return judge(candidate, without, conditions)

    def together_to_the_end(
        together: Together, without: Collection[str], conditions: Sequence[Condition[Together]]
    ) -> tuple[Checked, ...]:
        effects = " and ".join(effect.term.effect for effect in together.naming.named)
        judged.append((f"{whose}, {effects} together", judge(together, NAMES, TOGETHER)))
        return judge(together, without, conditions)

    with (
        mock.patch.object(naming, "judge", candidate_to_the_end),
        mock.patch.object(explanation, "judge", together_to_the_end),
    ):
        diagnosed()
    return judged


def of_split(split: Split) -> list[Judged]:
    """Of recordings of a vehicle."""
    return tried(lambda: analyse(list(split.diagnosed), split.robot), split.vehicle)


def of_case(part: Part, seed: int, number: int) -> list[Judged]:
    """Of a simulated case, named by what is hidden in it."""
    case = make_case(part, seed, number)
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"drive{index}.parquet" for index in range(len(case.recordings))]
        for file, frame in zip(files, case.recordings, strict=True):
            frame.to_parquet(file, index=False)
        try:
            return tried(
                lambda: analyse(files, case.nominal), f"{' and '.join(case.hidden) or part}:"
            )
        except RecordingError:
            return []


def main(args: Args) -> None:
    """Run what was asked for and print how often each condition refuses, and how often it alone
    does."""
    work: list[Any] = [delayed(of_split)(split) for split in at_hand(args.sets)]
    if args.seed is not None:
        parts: list[Part] = [
            part for part in PARTS if part in ("singles", "pairs", "controls", "outside")
        ]
        work += [
            delayed(of_case)(part, args.seed, number)
            for part in parts
            for number in range(args.cases)
        ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        judged: list[Judged] = []
        for of_recordings in Parallel(args.jobs)(work):
            judged += of_recordings
    refused = Counter[str]()
    alone = Counter[str]()
    whom = dict[str, Counter[str]]()
    for who, checks in judged:
        failed = [check.condition for check in checks if not check.holds]
        refused.update(failed)
        if len(failed) == 1:
            alone.update(failed)
            whom.setdefault(failed[0], Counter())[who] += 1
    together = sum(who.endswith("together") for who, _ in judged)
    table = Table(
        title=f"{len(judged) - together} candidates, {together} times all named effects together"
    )
    for head in ("condition", "refuses", "alone", "whom alone"):
        table.add_column(head)
    for name in NAMES:
        names = ", ".join(
            f"{who} ({count})" for who, count in whom.get(name, Counter()).most_common(12)
        )
        table.add_row(name, str(refused[name]), str(alone[name]), names)
    Console(width=150).print(table)


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
