"""What each condition for a name is worth: the candidates that it alone refuses, and what becomes
of their recordings without it.

`HOMEWARD_DATA=FOLDER python -m benchmarks.conditions --sets husky v9 leaf f1tenth eco` diagnoses
the parts of `benchmarks.real_drives`; `--sets --seed 413 --cases 17` so many cases of each part of
a seed of `benchmarks.concealed`. Every candidate, and all named effects together, are checked
against all conditions, not only up to the first that fails. A condition that refuses nothing alone
changes no name if it is left out. `--again` diagnoses recordings in which one does once more,
without it, and compares: paired, over all recordings of a part.
"""

from __future__ import annotations

import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import tyro
from joblib import Parallel, delayed
from rich.console import Console
from rich.table import Table

from benchmarks.concealed.paired import change
from benchmarks.concealed.plants.cases import Part
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.scoring.count import (
    false_alarm,
    found_first,
    in_some_class,
    wrongly_named,
)
from benchmarks.concealed.scoring.outcome import Outcome, ask
from benchmarks.real_drives import Set, Split, at_hand
from benchmarks.real_drives import run as diagnose_split
from homeward.diagnosis.explain import explanation, naming
from homeward.diagnosis.explain.candidate import Candidate
from homeward.diagnosis.explain.conditions import CONDITIONS, TOGETHER, Condition, judge
from homeward.diagnosis.explain.together import Together
from homeward.diagnosis.result import Checked

NAMES = (*(condition.name for condition in CONDITIONS), *(condition.name for condition in TOGETHER))
VEHICLES = "vehicles"
WIDTH = 150  # chosen: characters, so that most rows stay in a line

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
    again: bool = False
    """Diagnose again without each condition that alone refuses someone: takes two to four times as
    long."""
    jobs: int = 2
    """Processes."""


@dataclass(frozen=True)
class Answer:
    """What a diagnosis of some recordings says."""

    names: tuple[str, ...]
    # 1 if a simulated case is answered rightly, else 0; of a vehicle, the error of the energy of a
    # later drive by the file, %
    score: float


@dataclass(frozen=True)
class Recordings:
    """Recordings that were diagnosed, and again without conditions that alone refused someone."""

    part: str  # of the simulated cases, or VEHICLES
    judged: Sequence[Judged]
    answer: Answer
    without: dict[str, Answer] = field(default_factory=dict)  # by condition


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


def failed(checks: Sequence[Checked]) -> list[str]:
    """The conditions that are not met."""
    return [check.condition for check in checks if not check.holds]


def alone(judged: Sequence[Judged]) -> tuple[str, ...]:
    """The conditions that alone refuse someone."""
    refusals = [failed(checks) for _, checks in judged]
    return tuple(dict.fromkeys(names[0] for names in refusals if len(names) == 1))


def diagnosed_again(
    part: str, whose: str, diagnose: Callable[[Sequence[str]], Answer], again: bool
) -> Recordings:
    """Diagnose recordings, and `again` without each condition that alone refuses someone."""
    answers: list[Answer] = []
    judged = tried(lambda: answers.append(diagnose(())), whose)
    without = {}
    if again:
        without = {name: diagnose((name,)) for name in alone(judged)}
    return Recordings(part, judged, answers[0], without)


def of_split(split: Split, again: bool) -> Recordings:
    """Recordings of a vehicle."""

    def diagnose(without: Sequence[str]) -> Answer:
        outcome = diagnose_split(split, without)
        names = (outcome.verdict, *outcome.named)
        return Answer(names, score=outcome.errors["file"].drive_pct)

    return diagnosed_again(VEHICLES, split.vehicle, diagnose, again)


def is_right(outcome: Outcome) -> bool:
    """Whether the answer counts as right: found, both found, no false alarm, no wrong name."""
    if outcome.part == "singles":
        return found_first(outcome)
    if outcome.part == "pairs":
        return all(in_some_class(outcome, effect) for effect in outcome.hidden)
    if outcome.part == "controls":
        return not false_alarm(outcome)
    return not wrongly_named(outcome)


def of_case(part: Part, seed: int, number: int, again: bool) -> Recordings:
    """A simulated case, named by what is hidden in it."""
    case = make_case(part, seed, number)

    def diagnose(without: Sequence[str]) -> Answer:
        with tempfile.TemporaryDirectory() as folder:
            outcome = ask(case, Path(folder), without)
        names = (outcome.verdict, *(effects[0] for effects in outcome.classes))
        return Answer(names, score=float(is_right(outcome)))

    return diagnosed_again(part, f"{' and '.join(case.hidden) or part}:", diagnose, again)


SIMULATED: tuple[Part, ...] = ("singles", "pairs", "controls", "outside")


def main(args: Args) -> None:
    """Run what was asked for and print how often each condition refuses, how often it alone does,
    and what that changes."""
    work: list[Any] = [delayed(of_split)(split, args.again) for split in at_hand(args.sets)]
    if args.seed is not None:
        work += [
            delayed(of_case)(part, args.seed, number, args.again)
            for part in SIMULATED
            for number in range(args.cases)
        ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recordings: list[Recordings] = Parallel(args.jobs)(work)
    console = Console(width=WIDTH)
    console.print(refusals(recordings))
    if args.again:
        console.print(changes(recordings))


def refusals(recordings: Sequence[Recordings]) -> Table:
    """How often each condition refuses, and whom it alone does."""
    refused = Counter[str]()
    refused_alone = Counter[str]()
    whom = dict[str, Counter[str]]()
    judged = [judgement for diagnosed in recordings for judgement in diagnosed.judged]
    for who, checks in judged:
        names = failed(checks)
        refused.update(names)
        if len(names) == 1:
            refused_alone.update(names)
            whom.setdefault(names[0], Counter())[who] += 1
    together = sum(who.endswith("together") for who, _ in judged)
    table = Table(
        title=f"{len(judged) - together} candidates, {together} times all named effects together"
    )
    for head in ("condition", "refuses", "alone", "whom alone"):
        table.add_column(head)
    for name in NAMES:
        most_common = whom.get(name, Counter()).most_common(12)
        text = ", ".join(f"{who} ({count})" for who, count in most_common)
        table.add_row(name, str(refused[name]), str(refused_alone[name]), text)
    return table


def changes(recordings: Sequence[Recordings]) -> Table:
    """What becomes of the answers without each condition, by part."""
    table = Table(title="Without the condition")
    scores = ("right, or error of a drive", "without")
    for head in ("condition", "part", "other names", *scores, "difference, 95 %"):
        table.add_column(head)
    parts = dict.fromkeys(diagnosed.part for diagnosed in recordings)
    for name in NAMES:
        for part in parts:
            of_part = [diagnosed for diagnosed in recordings if diagnosed.part == part]
            table.add_row(name, part, *_change_without(name, of_part))
    return table


def _change_without(name: str, recordings: Sequence[Recordings]) -> tuple[str, str, str, str]:
    """How many of these recordings have other names without a condition; counts or errors with it,
    without it, and their paired difference."""
    others = 0
    before: list[float] = []
    after: list[float] = []
    for diagnosed in recordings:
        answer = diagnosed.answer
        # Where it refuses nobody alone, the answer is the same.
        without = diagnosed.without.get(name, answer)
        others += without.names != answer.names
        before.append(answer.score)
        after.append(without.score)
    counted = f"{others} of {len(recordings)}"
    if recordings[0].part == VEHICLES:
        means = (f"{sum(before) / len(before):.2f} %", f"{sum(after) / len(after):.2f} %")
        return counted, *means, change(before, after, 1.0, " points", 2)
    return counted, f"{sum(before):.0f}", f"{sum(after):.0f}", change(before, after, 100.0, " %", 1)


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
