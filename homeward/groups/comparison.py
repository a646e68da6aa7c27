"""Which quantities differ significantly between named groups of runs, relative to the spread
between runs.

Every run gives one value of each quantity, so that runs, not samples, count as independent. Two
groups are compared by Welch's test (Biometrika 34, 1947); since two or three runs estimate a spread
poorly, a group's variance is at least the one pooled over all groups. The procedure of Benjamini &
Hochberg (Journal of the Royal Statistical Society B 57, 1995) over all pairs and quantities keeps
the expected share of false ones among the named differences at 5 %, as Williams, Jones & Tukey
(Journal of Educational and Behavioral Statistics 24, 1999) advise for pairs of groups: with more
groups, true differences do not need more runs each. Holm's p-value (Scandinavian Journal of
Statistics 6, 1979), for any false positive at all, is given beside it.
"""

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.stats import false_discovery_control
from scipy.stats import t as student

from homeward.groups import thresholds
from homeward.groups.standing import mean_interval
from homeward.layout.notation import interval, number, unit_after
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording

SCHEMA = 2
"""Version of the format of the comparison as JSON. In version 1, differences had no `p_fdr`, and
were named by `p_holm`."""

_MOST_SHOWN = 4  # differences in the summary; chosen: two sentences

GroupVerdict = Literal["groups_differ", "no_difference", "not_testable"]


@dataclass(frozen=True)
class Quantity:
    """What is compared: the symbol of a group of parameters or the name of an effect, and its
    unit."""

    name: str
    unit: str


@dataclass(frozen=True)
class Level:
    """A quantity in one group; the interval includes the spread between runs; of one run only that
    within it."""

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

    The interval is of this pair alone. `p_fdr` (false discovery rate) and `p_holm` (any false
    positive) are corrected for all pairs and quantities. Held-out errors are of runs predicted from
    the others: from those of their own group, and from those of both.
    """

    quantity: str
    unit: str
    group: str
    minus: str
    value: float
    ci95: tuple[float, float]
    p_value: float
    p_fdr: float
    p_holm: float
    held_out_rmse: float
    held_out_rmse_without_groups: float
    named: bool


@dataclass(frozen=True)
class RunValues:
    """A run of a group and its value of each quantity, None where it is not identifiable from the
    run."""

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


def compare(
    labels: Sequence[str], values: Mapping[Quantity, Array]
) -> tuple[list[Level], list[Difference]]:
    """Levels of all groups, and the differences of all pairs that have at least two runs each.

    Differences come in the order of the quantities, those of one quantity by p-value.

    A difference is named where `p_fdr` is at most `thresholds.LEVEL` and held-out runs are
    predicted better from their own group than from both together. `labels` are the groups of the
    runs; `values` have shape (runs,) each, NaN where the quantity is not identifiable from a run.
    """
    groups = np.array(labels)
    levels: list[Level] = []
    pairs: list[Difference] = []
    for quantity, by_run in values.items():
        is_identified = np.isfinite(by_run)
        by_group = {
            group: by_run[(groups == group) & is_identified] for group in dict.fromkeys(labels)
        }
        levels += [_level(quantity, group, runs) for group, runs in by_group.items() if len(runs)]
        pairs += _differences(quantity, by_group)
    order = [quantity.name for quantity in values]
    return levels, sorted(_corrected(pairs), key=lambda pair: order.index(pair.quantity))


def _level(quantity: Quantity, group: str, runs: Array) -> Level:
    """Mean of a group's runs, shape (runs,), with its interval and their spread, where there are
    two or more."""
    several = len(runs) > 1
    return Level(
        quantity=quantity.name,
        unit=quantity.unit,
        group=group,
        value=float(runs.mean()),
        ci95=mean_interval(runs.tolist()) if several else None,
        runs=len(runs),
        run_spread=float(np.std(runs, ddof=1)) if several else None,
    )


def _corrected(pairs: Sequence[Difference]) -> list[Difference]:
    """The differences by p-value, corrected for their number, and named where that is significant
    and groups predict better."""
    in_order = sorted(pairs, key=lambda difference: difference.p_value)
    false_discovery_rates = false_discovery_control([pair.p_value for pair in in_order]).tolist()
    corrected = []
    p_holm = 0.0
    for rank, (pair, p_fdr) in enumerate(zip(in_order, false_discovery_rates, strict=True)):
        # A step-down p-value is at least that of the step before.
        p_holm = max(p_holm, min((len(pairs) - rank) * pair.p_value, 1.0))
        predicts_better = pair.held_out_rmse < pair.held_out_rmse_without_groups
        is_named = p_fdr <= thresholds.LEVEL and predicts_better
        corrected.append(dataclasses.replace(pair, p_fdr=p_fdr, p_holm=p_holm, named=is_named))
    return corrected


@dataclass(frozen=True)
class _Spread:
    """Variance between the runs of a group, and its degrees of freedom."""

    variance: float
    freedom: int


def _differences(quantity: Quantity, by_group: Mapping[str, Array]) -> Iterator[Difference]:
    """Each pair of groups by Welch's test, without a correction for their number."""
    all_runs = np.concatenate(list(by_group.values()))
    largest = max(float(np.max(np.abs(all_runs), initial=0.0)), 1e-9)
    rounding = (thresholds.SMALLEST_SPREAD * largest) ** 2
    runs_of = {group: runs for group, runs in by_group.items() if len(runs) > 1}
    spreads = {
        group: _Spread(variance=max(float(np.var(runs, ddof=1)), rounding), freedom=len(runs) - 1)
        for group, runs in runs_of.items()
    }
    freedom = sum(spread.freedom for spread in spreads.values())
    summed = sum(spread.variance * spread.freedom for spread in spreads.values())
    pooled = _Spread(summed / max(freedom, 1), freedom)
    for minus, group in combinations(runs_of, 2):
        error, degrees = _error([spreads[group], spreads[minus]], pooled)
        value = float(runs_of[group].mean() - runs_of[minus].mean())
        half = float(student.ppf(thresholds.UPPER_95, degrees)) * error
        p_value = float(2.0 * student.sf(abs(value) / error, degrees))
        yield Difference(
            quantity=quantity.name,
            unit=quantity.unit,
            group=group,
            minus=minus,
            value=value,
            ci95=(value - half, value + half),
            p_value=p_value,
            p_fdr=p_value,
            p_holm=p_value,
            held_out_rmse=_left_out_rmse(runs_of[group], runs_of[minus]),
            held_out_rmse_without_groups=_left_out_rmse(
                np.concatenate([runs_of[group], runs_of[minus]])
            ),
            named=False,
        )


def _error(spreads: Sequence[_Spread], pooled: _Spread) -> tuple[float, float]:
    """Standard error of the difference of the means of two groups, and its degrees of freedom
    (Welch).

    The spread of a group is at least the pooled one.
    """
    variances = []  # of the means
    squares = 0.0
    for spread in spreads:
        at_least_pooled = spread if spread.variance > pooled.variance else pooled
        runs = spread.freedom + 1
        variance = at_least_pooled.variance / runs
        variances.append(variance)
        squares += variance**2 / at_least_pooled.freedom
    total = sum(variances)
    degrees = min(total**2 / squares, pooled.freedom)  # Satterthwaite (Biometrics Bulletin 2, 1946)
    return float(np.sqrt(total)), degrees


def _left_out_rmse(*groups: Array) -> float:
    """Error (RMS) of runs predicted by the mean of the other runs of their group."""
    errors = []
    for runs in groups:
        count = len(runs)
        # The mean of the other runs is n / (n - 1) times as far from a run as the mean of all.
        errors.append((runs.mean() - runs) * count / (count - 1))
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def comparison_of(
    kind: Literal["standing", "driving"],
    recordings: Sequence[Recording],
    labels: Sequence[str],
    values: Mapping[Quantity, Array],
    levels: Sequence[Level],
    differences: Sequence[Difference],
    remarks: Sequence[str],
) -> Comparison:
    """The comparison of these recordings, with its verdict and summary; of one group the level
    alone."""
    runs = []
    for index, (recording, label) in enumerate(zip(recordings, labels, strict=True)):
        of_run = {
            quantity.name: _or_none(float(by_run[index])) for quantity, by_run in values.items()
        }
        runs.append(RunValues(recording.name, recording.sha256, label, of_run))
    notes = [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    groups = list(dict.fromkeys(labels))
    verdict, summary = _conclusion(differences, groups)
    if len(groups) == 1:
        summary = _level_in_words(levels[0])
    return Comparison(
        kind=kind,
        verdict=verdict,
        summary=summary,
        runs=tuple(runs),
        levels=tuple(levels),
        differences=tuple(differences),
        remarks=(*remarks, *notes),
    )


def _or_none(value: float) -> float | None:
    """A value as JSON has it: null where it is not identifiable."""
    return value if np.isfinite(value) else None


def _level_in_words(level: Level) -> str:
    ends = "" if level.ci95 is None else f" (95 %: {interval(level.ci95, 4)})"
    how = f"the mean of {level.runs} runs" if level.runs > 1 else "one run alone"
    return f"{level.quantity} is {number(level.value, 4)} {level.unit}{ends}, {how}."


def _conclusion(
    differences: Sequence[Difference], groups: Sequence[str]
) -> tuple[GroupVerdict, str]:
    """Verdict by the differences of all pairs that can be tested, and one or two sentences on it,
    in their order."""
    if not differences:
        return "not_testable", (
            "Differences cannot be tested: no two groups have at least two usable runs each, so the spread between "
            "runs of one group is unknown."
        )
    tested = f"{len(differences)} compared"
    named = [_sentence(difference) for difference in differences if difference.named]
    if not named:
        between = f"No difference between {', '.join(groups)} is significant relative to the spread between runs"
        return "no_difference", f"{between} ({tested}, Benjamini-Hochberg, 5 %)."
    shown = "; ".join(named[:_MOST_SHOWN])
    if len(named) > _MOST_SHOWN:
        shown = f"{shown}; and {len(named) - _MOST_SHOWN} more"
    return "groups_differ", (
        f"{shown}. Significant: {len(named)} of {tested} (Benjamini-Hochberg: of these, at most 5 % are expected to be "
        "false)."
    )


def _sentence(difference: Difference) -> str:
    """A difference in words, the higher group first."""
    if difference.value > 0.0:
        groups = f"{difference.group} than in {difference.minus}"
    else:
        groups = f"{difference.minus} than in {difference.group}"
    size = number(abs(difference.value)) + unit_after(difference.unit)
    # Named differences have intervals on one side of zero, so that their ends keep their order or
    # swap it.
    smallest, largest = sorted(abs(end) for end in difference.ci95)
    return f"{difference.quantity} is {size} higher in {groups} (95 %: {interval((smallest, largest))})"
