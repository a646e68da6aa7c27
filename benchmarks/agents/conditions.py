"""Score that instruments and rough ground cost the planner at `uncertain` and `harsh`, and its gain
over the rules.

`python benchmarks/agents/conditions.py` prints the planner's score with the instruments of the
difficulty, also relative to that with exact ones in the same weather, on the same episodes. It also
prints the gain over the rules at equal stranding: each rule is run with all reserves of its tuning
and larger ones, and its score is interpolated where its stranding rate equals the planner's.
"""

from __future__ import annotations

import dataclasses
import itertools
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.agents.tune import NUMBERS, RULES
from benchmarks.tables import rate, span, table
from homeward import cli
from homeward.agents.evaluation import Episodes, episode_seeds
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.evaluation.tasks import run_agents
from homeward.agents.evaluation.tradeoff import Curve
from homeward.agents.registry import AGENTS, Request
from homeward.envs.options import OptionError, Options, known_of
from homeward.parallel import ClusterError, TaskError

Array = NDArray[np.float64]
Ends = list[float] | None
_FURTHER = (1.25, 1.5, 2.0)
"""Reserves beyond the largest of those that a rule is tuned over, as multiples of it: few strand
with them."""
# of missions; chosen: the 2.5 % beyond an end are then sure to 0.5 % (standard error)
_RESAMPLES = 999


@dataclass(frozen=True)
class Args:
    """What to run."""

    missions: tuple[str, ...] = ("OutAndBack", "Survey")
    """Missions."""
    difficulties: tuple[str, ...] = ("uncertain", "harsh")
    """Difficulties."""
    episodes: int = 2000
    """Episodes of each."""
    seed: int = 0
    """Seed of the episodes, as in evaluate.py."""
    jobs: int = 1
    """Processes at once."""


def main(args: Args) -> None:
    """Run and print.

    Raises:
        OptionError, ClusterError, TaskError: An argument cannot be used, or an agent failed.
    """
    if args.episodes < 2 or args.seed < 0:
        raise OptionError("give at least 2 --episodes and a --seed of 0 or more")
    title = f"planner, {args.episodes} episodes, episode_seeds({args.seed}, {args.episodes})"
    alone = table(title, ("mission", "difficulty"), ("score", "stranded (95 %)", "of exact (95 %)"))
    above = table(f"{title}: above rules at equal stranding", ("mission", "difficulty", "rule"),
                  ("rule's score there", "planner above it (95 %)"))  # fmt: skip
    for mission, difficulty in itertools.product(args.missions, args.difficulties):
        options = Options(mission, difficulty=difficulty)
        metered = episodes_of(args, options, "planner", None)
        exact = episodes_of(
            args, dataclasses.replace(options, instruments="exact"), "planner", None
        )
        stranded = rate(int(metered.stranded.sum()), args.episodes)
        shown = share_of(metered.score, exact.score, args.seed)
        alone.add_row(mission, difficulty, f"{metered.score.mean():.4g}", stranded, shown)
        gains = gains_of(args, options, metered)
        highest = max(score or 0.0 for score, _, _ in gains.values())
        for rule, (score, gain, ci95) in gains.items():
            at_equal = "more strand" if score is None else f"{score:.4g}"
            shown = span(gain, ci95, "+.1%") if gain is not None and ci95 else ""
            above.add_row(
                mission, difficulty, rule, at_equal, shown, style="bold" if score == highest else ""
            )
    console = Console(width=140)
    console.print(alone)
    console.print(above)


def episodes_of(args: Args, options: Options, name: str, reserve: float | None) -> Episodes:
    """Episodes of an agent with a reserve, or with its own."""
    agents = {name: [AGENTS[name](Request(known_of(options), reserve=reserve))]}
    return run_agents(agents, options, episode_seeds(args.seed, args.episodes), jobs=args.jobs)[
        name
    ][0].episodes


def share_of(metered: Array, exact: Array, seed: int) -> str:
    """Ratio of the mean scores of the same episodes, with its paired interval; "" where none
    scored."""
    if exact.mean() <= 0.0:
        return ""
    means = Bootstrap(
        {"metered": metered[None], "exact": exact[None]}, np.random.default_rng(seed)
    ).means()
    has_score = means["exact"] > 0.0  # a resample of very few episodes may contain none that scored
    ratios = means["metered"][has_score] / means["exact"][has_score]
    return span(metered.mean() / exact.mean(), interval(ratios), ".1%")


def gains_of(
    args: Args, options: Options, planner: Episodes
) -> dict[str, tuple[float | None, float | None, Ends]]:
    """For each rule its score at the planner's stranding rate, the planner's gain over it and the
    interval of the gain.

    Score and gain are None where it strands more often with every reserve.
    """
    count = len(planner.score)
    gains = {}
    equal_weights = np.full(count, 1.0 / count)
    resamples = (
        np.random.default_rng(args.seed).multinomial(count, equal_weights, _RESAMPLES) / count
    )
    for name in RULES:
        largest = NUMBERS[name][-1]
        reserves = (*NUMBERS[name], *(largest * factor for factor in _FURTHER))
        rule = {reserve: episodes_of(args, options, name, reserve) for reserve in reserves}
        score, gain = gain_on(rule, planner, equal_weights)
        resampled = []
        for weights in resamples:
            _, resampled_gain = gain_on(rule, planner, weights)
            if resampled_gain is not None:
                resampled.append(resampled_gain)
        gains[name] = score, gain, interval(np.array(resampled)) if resampled else None
    return gains


def gain_on(
    rule: Mapping[float, Episodes], planner: Episodes, weight: Array
) -> tuple[float | None, float | None]:  # fmt: skip
    """Score of a rule and the planner's gain over it, for weighted episodes."""
    scores = tuple(float(weight @ episodes.score) for episodes in rule.values())
    stranded = tuple(float(weight @ episodes.stranded) for episodes in rule.values())
    score = Curve(tuple(rule), scores, stranded).at(float(weight @ planner.stranded))
    if not score:
        return score, None
    return score, float(weight @ planner.score) / score - 1.0


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, ClusterError, TaskError)))
