"""What each condition for a name is worth on real recordings: the candidates that it alone refuses.

`HOMEWARD_DATA=FOLDER python -m benchmarks.conditions --sets husky v9 leaf f1tenth eco` diagnoses the parts of
`benchmarks.real_drives` and checks every candidate against all conditions, not only up to the first that fails. A
condition that refuses nothing alone changes no name if it is left out.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from unittest import mock

import tyro
from joblib import Parallel, delayed
from rich.console import Console
from rich.table import Table

from benchmarks.real_drives import Set, Split, at_hand
from homeward.diagnosis import analyse
from homeward.diagnosis.explain import naming
from homeward.diagnosis.explain.candidate import Candidate
from homeward.diagnosis.explain.conditions import CONDITIONS, Condition, judge
from homeward.diagnosis.result import Checked

ALL = tuple(condition.name for condition in CONDITIONS)


@dataclass(frozen=True)
class Args:
    """What to run."""

    sets: tuple[Set, ...] = ("husky", "v9", "leaf", "f1tenth", "eco")
    """Vehicles."""
    jobs: int = 2
    """Processes."""


def tried(split: Split) -> list[tuple[str, tuple[Checked, ...]]]:
    """Every candidate that was judged, with the values of all conditions: vehicle and effect, and checks."""
    judged: list[tuple[str, tuple[Checked, ...]]] = []

    def to_the_end(
        candidate: Candidate, without: Collection[str] = (), conditions: Sequence[Condition] = CONDITIONS
    ) -> tuple[Checked, ...]:
        judged.append((f"{split.vehicle}, {candidate.term.effect}", judge(candidate, ALL, CONDITIONS)))
        return judge(candidate, without, conditions)

    with mock.patch.object(naming, "judge", to_the_end):
        analyse(list(split.diagnosed), split.robot)
    return judged


def main(args: Args) -> None:
    """Run the sets and print how often each condition refuses, and how often it alone does."""
    work = at_hand(args.sets)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = [each for part in Parallel(args.jobs)(delayed(tried)(split) for split in work) for each in part]
    refused, alone, whom = Counter[str](), Counter[str](), dict[str, Counter[str]]()
    for who, checks in found:
        failed = [check.condition for check in checks if not check.holds]
        refused.update(failed)
        if len(failed) == 1:
            alone.update(failed)
            whom.setdefault(failed[0], Counter())[who] += 1
    table = Table(title=f"{len(found)} candidates of {len(work)} parts of real recordings")
    for head in ("condition", "refuses", "alone", "whom alone"):
        table.add_column(head)
    for name in ALL:
        names = ", ".join(f"{who} ({count})" for who, count in whom.get(name, Counter()).most_common(6))
        table.add_row(name, str(refused[name]), str(alone[name]), names)
    Console(width=150).print(table)


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
