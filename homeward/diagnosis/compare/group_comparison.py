"""Which quantities differ between named groups of runs, with the spread from run to run as the yardstick.

Every run gives one value of each quantity, so that runs, not samples, count as independent. Two groups are compared
by Welch's test (Biometrika 34, 1947); since two or three runs tell little about a spread, a group's variance is taken
no smaller than the one pooled over all groups. Holm's procedure (Scandinavian Journal of Statistics 6, 1979) over all
pairs and quantities keeps the probability of any false name at 5 %.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis.compare.standing import mean_interval
from homeward.diagnosis.read.signals import Array
from homeward.diagnosis.tell.formats import number

SCHEMA = 1
LEVEL = 0.05
"""Probability of at least one false name where no group differs."""

_FEWEST_RUNS = 2  # of each group of a pair
_SMALLEST_SPREAD = 1e-6  # of the largest value: runs that agree better are rounded

GroupVerdict = Literal["groups_differ", "no_difference", "not_testable"]


@dataclass(frozen=True)
class Quantity:
    """What is compared: the symbol of a group of parameters or the name of an effect, and its unit."""

    name: str
    unit: str


@dataclass(frozen=True)
class Level:
    """A quantity in one group; the interval counts the spread between runs, and of one run only that within it."""

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

    The interval is of this pair alone; `p_holm` reckons with all pairs and quantities. Held-out errors are of runs
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
    """A run of a group and its value of each quantity, None where the run does not show it."""

    path: str
    sha256: str
    group: str
    values: Mapping[str, float | None]


@dataclass(frozen=True)
class Comparison:
    """What groups.json holds."""

    kind: Literal["standing", "driving"]
    verdict: GroupVerdict
    summary: str
    runs: tuple[RunValues, ...]
    levels: tuple[Level, ...]
    differences: tuple[Difference, ...]
    remarks: tuple[str, ...]
    level: float = LEVEL
    schema: int = SCHEMA

    @property
    def groups(self) -> list[str]:
        """Names of the groups in the order in which they were given."""
        return list(dict.fromkeys(run.group for run in self.runs))

    def to_json(self) -> str:
        """Text of groups.json."""
        data = dataclasses.asdict(self)
        return json.dumps({"schema": data.pop("schema"), **data}, indent=2, allow_nan=False) + "\n"


def compare(labels: Sequence[str], values: Mapping[Quantity, Array]) -> tuple[list[Level], list[Difference]]:
    """Levels of all groups, and the differences of all pairs that have at least two runs each, the surest first.

    A difference is named where Holm's p-value is at most `LEVEL` and runs that were left out are predicted better from
    their own group than from both together.

    Args:
        labels: Group of each run.
        values: Value of each quantity in each run, shape (runs,), NaN where a run does not show it.
    """
    groups = list(dict.fromkeys(labels))
    levels: list[Level] = []
    pairs: list[Difference] = []
    for quantity, one in values.items():
        known = {name: one[(np.array(labels) == name) & np.isfinite(one)] for name in groups}
        levels += [_level(quantity, name, runs) for name, runs in known.items() if len(runs)]
        several = {name: runs for name, runs in known.items() if len(runs) >= _FEWEST_RUNS}
        freedom = {name: len(runs) - 1 for name, runs in several.items()}
        largest = float(np.max(np.abs(one), initial=1e-9, where=np.isfinite(one)))
        tiny = (_SMALLEST_SPREAD * largest) ** 2
        own = {name: max(float(np.var(runs, ddof=1)), tiny) for name, runs in several.items()}
        pooled = sum(own[name] * freedom[name] for name in several) / max(sum(freedom.values()), 1)
        for second, first in combinations(several, 2):
            pairs.append(_difference(quantity, first, second, several, own, freedom, pooled))
    return levels, _holm(pairs)


def _level(quantity: Quantity, group: str, runs: Array) -> Level:
    several = len(runs) > 1
    interval, spread = (mean_interval(runs.tolist()), float(np.std(runs, ddof=1))) if several else (None, None)
    return Level(quantity.name, quantity.unit, group, float(runs.mean()), interval, len(runs), spread)


def _difference(
    quantity: Quantity, first: str, second: str, runs: Mapping[str, Array], own: Mapping[str, float],
    freedom: Mapping[str, int], pooled: float,
) -> Difference:  # fmt: skip
    every = sum(freedom.values())
    shares, squares = [], 0.0
    for name in (first, second):
        wide = own[name] > pooled
        shares.append((own[name] if wide else pooled) / len(runs[name]))
        squares += shares[-1] ** 2 / (freedom[name] if wide else every)
    error = float(np.sqrt(sum(shares)))
    degrees = min(sum(shares) ** 2 / squares, every)  # Satterthwaite (Biometrics Bulletin 2, 1946)
    value = float(runs[first].mean() - runs[second].mean())
    half = float(student.ppf(0.975, degrees)) * error
    p_value = float(2.0 * student.sf(abs(value) / error, degrees))
    left_out = _held_out(runs[first], runs[second])
    return Difference(
        quantity.name, quantity.unit, first, second, value, (value - half, value + half), p_value, p_value, *left_out,
        named=False,
    )  # fmt: skip


def _held_out(first: Array, second: Array) -> tuple[float, float]:
    """Errors (RMS) of runs predicted by the mean of the other runs of their group, and of both groups."""
    both = np.concatenate([first, second])
    of_group = np.concatenate([(one.mean() - one) * len(one) / (len(one) - 1) for one in (first, second)])
    of_both = (both.mean() - both) * len(both) / (len(both) - 1)
    return float(np.sqrt(np.mean(of_group**2))), float(np.sqrt(np.mean(of_both**2)))


def _holm(pairs: Sequence[Difference]) -> list[Difference]:
    ordered = sorted(pairs, key=lambda one: one.p_value)
    adjusted, largest = [], 0.0
    for rank, one in enumerate(ordered):
        largest = max(largest, min((len(ordered) - rank) * one.p_value, 1.0))
        foretold = one.held_out_rmse < one.held_out_rmse_without_groups
        adjusted.append(dataclasses.replace(one, p_holm=largest, named=largest <= LEVEL and foretold))
    return adjusted


def verdict_of(differences: Sequence[Difference]) -> GroupVerdict:
    """Verdict by the differences of all pairs that can be tested."""
    if not differences:
        return "not_testable"
    return "groups_differ" if any(one.named for one in differences) else "no_difference"


def summary_of(differences: Sequence[Difference], groups: Sequence[str], most: int = 4) -> str:
    """One or two sentences on what differs, the surest first.

    Args:
        differences: As `compare` gives them.
        groups: Names of all groups.
        most: Differences that are spelled out.
    """
    verdict = verdict_of(differences)
    if verdict == "not_testable":
        return (
            "Nothing can be said of differences: no two groups have at least two runs each, so how much runs of one "
            "group differ is not known."
        )
    tested = f"{len(differences)} compared"
    if verdict == "no_difference":
        between = ", ".join(groups)
        return f"No difference between {between} stands out from the spread between runs ({tested}, Holm, 5 % in all)."
    named = [one for one in differences if one.named]
    said = "; ".join(said_of(one) for one in named[:most])
    more = f"; and {len(named) - most} more" if len(named) > most else ""
    return f"{said}{more}. {len(named)} of {tested} can be named (Holm, 5 % in all)."


def said_of(one: Difference) -> str:
    """A difference in words, the higher group first."""
    high, low = (one.group, one.minus) if one.value > 0.0 else (one.minus, one.group)
    ends = sorted(abs(end) for end in one.ci95)
    unit = "" if one.unit == "1" else f" {one.unit}"
    return (
        f"{one.quantity} is {number(abs(one.value))}{unit} higher in {high} than in {low} (95 %: {number(ends[0])} to "
        f"{number(ends[1])})"
    )
