"""Which quantities differ significantly between named groups of runs, relative to the spread between runs.

Every run gives one value of each quantity, so that runs, not samples, count as independent. Two groups are compared
by Welch's test (Biometrika 34, 1947); since two or three runs estimate a spread poorly, a group's variance is at least
the one pooled over all groups. Holm's procedure (Scandinavian Journal of Statistics 6, 1979) over all
pairs and quantities keeps the probability of any false positive at 5 %.
"""

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.stats import t as student

from homeward.groups import thresholds
from homeward.groups.standing import mean_interval
from homeward.layout.notation import interval, number
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording

SCHEMA = 1
"""Version of the format of the comparison as JSON."""

_MOST_SHOWN = 4  # differences in the summary; chosen: two sentences

GroupVerdict = Literal["groups_differ", "no_difference", "not_testable"]


@dataclass(frozen=True)
class Quantity:
    """What is compared: the symbol of a group of parameters or the name of an effect, and its unit."""

    name: str
    unit: str


@dataclass(frozen=True)
class Level:
    """A quantity in one group; the interval includes the spread between runs; of one run only that within it."""

    quantity: str
    unit: str
    group: str
    value: float
    ci95: tuple[float, float] | None  # None where a single run gives none
    runs: int
    run_spread: float | None  # standard deviation between runs, None of a single run


@dataclass(frozen=True)
class Difference:
    """A quantity in one group minus that in another.

    The interval is of this pair alone; `p_holm` is corrected for all pairs and quantities. Held-out errors are of runs
    predicted from the others: from those of their own group, and from those of both.
    """

    quantity: str
    unit: str
    group: str
    minus: str
    value: float
    ci95: tuple[float, float]
    p_value: float
    p_holm: float
    held_out_rmse: float
    held_out_rmse_without_groups: float
    named: bool


@dataclass(frozen=True)
class RunValues:
    """A run of a group and its value of each quantity, None where it is not identifiable from the run."""

    path: str
    sha256: str
    group: str
    values: Mapping[str, float | None]


@dataclass(frozen=True)
class Comparison:
    """Content of groups.json."""

    kind: Literal["standing", "driving"]
    verdict: GroupVerdict
    summary: str
    runs: tuple[RunValues, ...]
    levels: tuple[Level, ...]
    differences: tuple[Difference, ...]
    remarks: tuple[str, ...]
    level: float = thresholds.LEVEL
    schema: int = SCHEMA

    @property
    def groups(self) -> list[str]:
        """Names of the groups in the order given."""
        return list(dict.fromkeys(run.group for run in self.runs))

    def to_json(self) -> str:
        """Text of groups.json."""
        data = dataclasses.asdict(self)
        return json.dumps({"schema": data.pop("schema"), **data}, indent=2, allow_nan=False) + "\n"


def compare(labels: Sequence[str], values: Mapping[Quantity, Array]) -> tuple[list[Level], list[Difference]]:
    """Levels of all groups, and the differences of all pairs that have at least two runs each.

    Differences come in the order of the quantities, those of one quantity by p-value.

    A difference is named where Holm's p-value is at most `thresholds.LEVEL` and held-out runs are predicted better from
    their own group than from both together. `labels` are the groups of the runs; `values` have shape (runs,) each, NaN
    where the quantity is not identifiable from a run.
    """
    levels: list[Level] = []
    pairs: list[Difference] = []
    for quantity, by_run in values.items():
        by_group = {name: by_run[(np.array(labels) == name) & np.isfinite(by_run)] for name in dict.fromkeys(labels)}
        for name, runs in by_group.items():
            interval = mean_interval(runs.tolist()) if len(runs) > 1 else None
            spread = float(np.std(runs, ddof=1)) if len(runs) > 1 else None
            if len(runs):
                mean = float(runs.mean())
                levels.append(Level(quantity.name, quantity.unit, name, mean, interval, len(runs), spread))
        pairs += _differences(quantity, by_group)
    named, largest = [], 0.0
    for rank, pair in enumerate(sorted(pairs, key=lambda difference: difference.p_value)):
        largest = max(largest, min((len(pairs) - rank) * pair.p_value, 1.0))
        predicts_better = pair.held_out_rmse < pair.held_out_rmse_without_groups
        named.append(dataclasses.replace(pair, p_holm=largest, named=largest <= thresholds.LEVEL and predicts_better))
    order = [quantity.name for quantity in values]
    return levels, sorted(named, key=lambda pair: order.index(pair.quantity))


def _differences(quantity: Quantity, by_group: Mapping[str, Array]) -> Iterator[Difference]:
    """Each pair of groups by Welch's test, without Holm's correction."""
    largest = max(float(np.max(np.abs(np.concatenate(list(by_group.values()))), initial=0.0)), 1e-9)
    several = {name: runs for name, runs in by_group.items() if len(runs) > 1}
    freedom = {name: len(runs) - 1 for name, runs in several.items()}
    every = sum(freedom.values())
    variances = {
        name: max(float(np.var(runs, ddof=1)), (thresholds.SMALLEST_SPREAD * largest) ** 2)
        for name, runs in several.items()
    }
    pooled = sum(variances[name] * freedom[name] for name in several) / max(every, 1)
    for minus, group in combinations(several, 2):
        shares, squares = [], 0.0
        for name in (group, minus):
            exceeds_pooled = variances[name] > pooled
            shares.append((variances[name] if exceeds_pooled else pooled) / len(several[name]))
            squares += shares[-1] ** 2 / (freedom[name] if exceeds_pooled else every)
        error = float(np.sqrt(sum(shares)))
        degrees = min(sum(shares) ** 2 / squares, every)  # Satterthwaite (Biometrics Bulletin 2, 1946)
        value = float(several[group].mean() - several[minus].mean())
        half = float(student.ppf(thresholds.UPPER_95, degrees)) * error
        p_value = float(2.0 * student.sf(abs(value) / error, degrees))
        runs = several[group], several[minus]
        yield Difference(
            quantity.name, quantity.unit, group, minus, value, (value - half, value + half), p_value, p_value,
            _left_out_rmse(*runs), _left_out_rmse(np.concatenate(runs)), named=False,
        )  # fmt: skip


def _left_out_rmse(*groups: Array) -> float:
    """Error (RMS) of runs predicted by the mean of the other runs of their group."""
    errors = [(runs.mean() - runs) * len(runs) / (len(runs) - 1) for runs in groups]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def comparison_of(
    kind: Literal["standing", "driving"], recordings: Sequence[Recording], labels: Sequence[str],
    values: Mapping[Quantity, Array], levels: Sequence[Level], differences: Sequence[Difference],
    remarks: Sequence[str],
) -> Comparison:  # fmt: skip
    """The comparison of these recordings, with its verdict and summary; of one group the level alone."""
    runs = tuple(
        RunValues(recording.name, recording.sha256, label, {
            quantity.name: float(by_run[i]) if np.isfinite(by_run[i]) else None for quantity, by_run in values.items()
        })
        for i, (recording, label) in enumerate(zip(recordings, labels, strict=True))
    )  # fmt: skip
    notes = [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    groups = list(dict.fromkeys(labels))
    verdict, summary = _conclusion(differences, groups)
    if len(groups) == 1:
        level = levels[0]
        ends = "" if level.ci95 is None else f" (95 %: {interval(level.ci95, 4)})"
        how = f"the mean of {level.runs} runs" if level.runs > 1 else "one run alone"
        summary = f"{level.quantity} is {number(level.value, 4)} {level.unit}{ends}, {how}."
    return Comparison(kind, verdict, summary, runs, tuple(levels), tuple(differences), (*remarks, *notes))


def _conclusion(differences: Sequence[Difference], groups: Sequence[str]) -> tuple[GroupVerdict, str]:
    """Verdict by the differences of all pairs that can be tested, and one or two sentences on it, in their order."""
    if not differences:
        return "not_testable", (
            "Differences cannot be tested: no two groups have at least two usable runs each, so the spread between "
            "runs of one group is unknown."
        )
    tested = f"{len(differences)} compared"
    named = [_sentence(difference) for difference in differences if difference.named]
    if not named:
        between = f"No difference between {', '.join(groups)} is significant relative to the spread between runs"
        return "no_difference", f"{between} ({tested}, Holm, 5 % in all)."
    unshown = f"; and {len(named) - _MOST_SHOWN} more" if len(named) > _MOST_SHOWN else ""
    shown = f"{'; '.join(named[:_MOST_SHOWN])}{unshown}"
    return "groups_differ", f"{shown}. Significant: {len(named)} of {tested} (Holm, 5 % in all)."


def _sentence(difference: Difference) -> str:
    """A difference in words, the higher group first."""
    high, low = (difference.group, difference.minus) if difference.value > 0.0 else (difference.minus, difference.group)
    near, far = sorted(abs(end) for end in difference.ci95)
    unit = "" if difference.unit == "1" else f" {difference.unit}"
    direction = f"{number(abs(difference.value))}{unit} higher in {high} than in {low}"
    return f"{difference.quantity} is {direction} (95 %: {interval((near, far))})"
