"""What instruments and rough ground cost: the planner and rules at `uncertain` and `harsh`, on the same episodes.

`python benchmarks/agents/conditions.py` prints scores and strandings with the instruments of the difficulty, relative
to exact ones in the same weather; and how far the planner is above the rules at equal stranding: each rule is run with
all reserves that it is tuned over and larger ones, and its score is read off the line through them, where no more
strand than of the planner's. OUT/conditions.json holds all.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.agents.tune import RULES
from benchmarks.tables import span, table
from homeward import cli
from homeward.agents import AgentError
from homeward.agents.evaluation import Episodes, episode_seeds
from homeward.agents.evaluation.statistics import Bootstrap, interval, wilson
from homeward.agents.evaluation.tasks import run_agents
from homeward.agents.registry import AGENTS, Request
from homeward.agents.rules.reserves import PACES
from homeward.envs.options import OptionError, Options, known_of
from homeward.files import write_whole
from homeward.parallel import ClusterError, TaskError

Array = NDArray[np.float64]
CONDITIONS: dict[str, dict[str, Any]] = {
    "uncertain, exact": {"difficulty": "uncertain", "instruments": "exact"},
    "uncertain": {"difficulty": "uncertain"},
    "harsh, exact": {"difficulty": "harsh", "instruments": "exact"},
    "harsh": {"difficulty": "harsh"},
}
"""Keyword arguments of the environment; what is not said is as its difficulty has it."""
EXACT = {"uncertain": "uncertain, exact", "harsh": "harsh, exact"}
"""The same condition with exact instruments; in these the planner is compared with rules at equal stranding."""
_FURTHER = (1.25, 1.5, 2.0)
"""Reserves beyond the largest of those that a rule is tuned over, as multiples of it: few strand with them."""
_RESAMPLES = 999  # of missions; chosen: the 2.5 % beyond an end are then sure to 0.5 % (standard error)


@dataclass(frozen=True)
class Args:
    """What to run."""

    missions: tuple[str, ...] = ("OutAndBack", "Survey")
    """Missions."""
    agents: tuple[str, ...] = ("dmax_adaptive", "dmax_belief", "planner")
    """Agents of evaluate.py that ship."""
    episodes: int = 2000
    """Episodes of each."""
    seed: int = 0
    """Seed that the episodes follow from, as in evaluate.py."""
    jobs: int = 1
    """Processes at once."""
    out: Path = Path("runs/conditions")
    """Folder of the results."""


Found = dict[str, dict[str, Episodes]]
"""Episodes by condition and agent."""


def main(args: Args) -> None:
    """Run and print.

    Raises:
        OptionError, AgentError, ClusterError, TaskError: An argument cannot be used, or an agent failed.
        OSError: The output folder cannot be written to.
    """
    if args.episodes < 2 or args.seed < 0:
        raise OptionError("give at least 2 --episodes and a --seed of 0 or more")
    if any(name not in AGENTS for name in args.agents):
        raise AgentError(f"give --agents of {', '.join(AGENTS)}")
    rows, curves, seeds = list[dict[str, Any]](), list[dict[str, Any]](), episode_seeds(args.seed, args.episodes)
    for mission in args.missions:
        found: Found = {}
        for condition, given in CONDITIONS.items():
            options = Options(mission, **given)
            agents = {name: [AGENTS[name](Request(known_of(options), None, 0))] for name in args.agents}
            runs = run_agents(agents, options, seeds, jobs=args.jobs)
            found[condition] = {name: one[0].episodes for name, one in runs.items()}
        rows += rows_of(mission, found, args.seed)
        for condition in EXACT if "planner" in args.agents else ():
            curves += [
                {"mission": mission, "condition": condition, **one}
                for one in compare(args, Options(mission, **CONDITIONS[condition]), found[condition]["planner"])
            ]
    console, title = Console(width=140), f"{args.episodes} episodes, episode_seeds({args.seed}, {args.episodes})"
    console.print(_conditions_table(title, rows))
    console.print(_curves_table(title, curves))
    content = {"episodes": args.episodes, "seed": args.seed, "rows": rows, "curves": curves}
    write_whole(args.out / "conditions.json", json.dumps(content, indent=2) + "\n")


def rows_of(mission: str, found: Found, seed: int) -> list[dict[str, Any]]:
    """Figures of each condition and agent.

    Args:
        mission: Its name.
        found: Episodes, the same ones for all.
        seed: Of resampling.
    """
    rows = []
    for condition, agents in found.items():
        for name, episodes in agents.items():
            stranded, count = int(episodes.stranded.sum()), len(episodes.score)
            row: dict[str, Any] = {
                "mission": mission, "condition": condition, "agent": name, "score_mean": float(episodes.score.mean()),
                "stranded_rate": stranded / count, "stranded_ci95": wilson(stranded, count),
            }  # fmt: skip
            if condition in EXACT:
                row |= _of_exact(episodes.score, found[EXACT[condition]][name].score, seed)
            rows.append(row)
    return rows


def _of_exact(metered: Array, exact: Array, seed: int) -> dict[str, Any]:
    """Mean over mean, with its paired interval."""
    if exact.mean() <= 0.0:
        return {}
    means = Bootstrap({"metered": metered[None], "exact": exact[None]}, seed).means()
    some = means["exact"] > 0.0  # of very few episodes a resample may hold none that scored
    ci95 = interval(means["metered"][some] / means["exact"][some])
    return {"of_exact": float(metered.mean() / exact.mean()), "of_exact_ci95": ci95}


def compare(args: Args, options: Options, planner: Episodes) -> list[dict[str, Any]]:
    """Score of each rule where no more strand than of the planner's episodes, and how far the planner is above it.

    Args:
        args: Seed, number of episodes and of processes.
        options: Of the environment.
        planner: Its episodes.
    """
    known, seeds = known_of(options), episode_seeds(args.seed, len(planner.score))
    rng, count = np.random.default_rng(args.seed), len(planner.score)
    weights = rng.multinomial(count, np.full(count, 1.0 / count), _RESAMPLES) / count
    of_planner = (planner.score, planner.stranded.astype(np.float64))
    rows = []
    for name, (rule, tuned_over) in RULES.items():
        reserves = [*tuned_over, *(tuned_over[-1] * more for more in _FURTHER)]
        agents = {f"{one:g}": [rule(known, PACES[options.mission], one)] for one in reserves}
        runs = run_agents(agents, options, seeds, jobs=args.jobs).values()
        scores = np.stack([run[0].episodes.score for run in runs], axis=-1)
        stranded = np.stack([run[0].episodes.stranded for run in runs], axis=-1).astype(np.float64)
        score, rate = (float(one.mean()) for one in of_planner)
        at_equal = score_at(scores.mean(axis=0), stranded.mean(axis=0), rate)
        drawn = [
            score / equal - 1.0
            for score, curve, rates, rate in zip(
                weights @ of_planner[0], weights @ scores, weights @ stranded, weights @ of_planner[1], strict=True
            )
            if (equal := score_at(curve, rates, rate)) is not None and equal > 0.0
        ]
        rows.append(
            {
                "rule": name, "planner_score": score, "stranded_rate": rate, "rule_score": at_equal,
                "gain": score / at_equal - 1.0 if at_equal else None,
                "gain_ci95": interval(np.array(drawn)) if at_equal and drawn else None,
                "reserves": reserves, "scores": scores.mean(axis=0).tolist(),
                "stranded_rates": stranded.mean(axis=0).tolist(),
            }
        )  # fmt: skip
    return rows


def score_at(scores: Sequence[float] | Array, stranded_rates: Sequence[float] | Array, most: float) -> float | None:
    """Highest score on the line through a rule's points where no more than a share strands; none where all strand more.

    Args:
        scores: Mean score by reserve.
        stranded_rates: Share that strands, by reserve.
        most: That share.

    >>> score_at([10.0, 8.0, 7.0], [0.4, 0.2, 0.0], 0.3)
    9.0
    """
    points = list(zip(scores, stranded_rates, strict=True))
    allowed = [float(score) for score, rate in points if rate <= most]
    for (one, from_rate), (other, to_rate) in itertools.pairwise(points):
        if min(from_rate, to_rate) < most < max(from_rate, to_rate):
            allowed.append(float(one + (other - one) * (most - from_rate) / (to_rate - from_rate)))
    return max(allowed, default=None)


def _conditions_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    left = ("mission", "condition", "agent")
    shown = table(title, left, ("score", "stranded (95 %)", "of exact (95 %)"))
    for row in rows:
        of_exact = span(row["of_exact"], row["of_exact_ci95"], ".1%") if "of_exact" in row else ""
        stranded = span(row["stranded_rate"], row["stranded_ci95"], ".2%")
        shown.add_row(*(row[name] for name in left), f"{row['score_mean']:.4g}", stranded, of_exact)
    return shown


def _curves_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    left = ("mission", "condition", "rule")
    right = ("planner", "stranded", "rule's score there", "planner above it (95 %)")
    shown = table(f"planner above rules at equal stranding, {title}", left, right)
    for _, group in itertools.groupby(rows, lambda row: (row["mission"], row["condition"])):
        ours = list(group)
        best = max(row["rule_score"] or 0.0 for row in ours)
        for row in ours:
            shown.add_row(
                *(row[name] for name in left), f"{row['planner_score']:.4g}", f"{row['stranded_rate']:.2%}",
                "more strand" if row["rule_score"] is None else f"{row['rule_score']:.4g}",
                span(row["gain"], row["gain_ci95"], "+.1%") if row["gain_ci95"] else "",
                style="bold" if row["rule_score"] == best else "",
            )  # fmt: skip
    return shown


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, AgentError, ClusterError, TaskError)))
