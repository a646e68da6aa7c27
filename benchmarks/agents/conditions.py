"""What instruments, weather and rough ground cost: the planner and rules from `known` to `harsh`, on the same episodes.

`python benchmarks/agents/conditions.py` prints scores and strandings by condition, relative to exact instruments in the
same weather; with `--optimum N` also shares of the oracle's two figures, on the first N episodes; and how far the
planner is above the rules at equal stranding: each rule is run with all reserves that it is tuned over and larger ones,
and its score is read off the line through them, where no more strand than of the planner's. OUT/conditions.json holds
all.
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
from rich import box
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.agents.tune import RULES
from homeward import cli
from homeward.agents import AgentError
from homeward.agents.evaluation import Episodes, episode_seeds
from homeward.agents.evaluation.statistics import Bootstrap, interval, wilson
from homeward.agents.evaluation.tasks import run_agents
from homeward.agents.oracle import Optimum, solve
from homeward.agents.registry import AGENTS, Request
from homeward.agents.rules.tuned import PACES
from homeward.envs.options import OptionError, Options, known_of
from homeward.files import write_whole
from homeward.parallel import ClusterError, TaskError

Array = NDArray[np.float64]
CONDITIONS: dict[str, dict[str, Any]] = {
    "known": {"difficulty": "known"},
    "uncertain, exact, still": {"difficulty": "uncertain", "instruments": "exact", "weather": "still"},
    "uncertain, exact": {"difficulty": "uncertain", "instruments": "exact"},
    "uncertain, still": {"difficulty": "uncertain", "weather": "still"},
    "uncertain": {"difficulty": "uncertain"},
    "harsh, exact": {"difficulty": "harsh", "instruments": "exact"},
    "harsh": {"difficulty": "harsh"},
}
"""Keyword arguments of the environment; what is not said is as its difficulty has it."""
EXACT = {
    "uncertain": "uncertain, exact",
    "uncertain, still": "uncertain, exact, still",
    "harsh": "harsh, exact",
}
"""The same condition with exact instruments."""
COMPARED = ("uncertain", "harsh")
"""Conditions in which the planner is compared with rules at equal stranding."""
_FURTHER = (1.25, 1.5, 2.0)
"""Reserves beyond the largest of those that a rule is tuned over, as multiples of it: few strand with them."""
_RESAMPLES = 999


@dataclass(frozen=True)
class Args:
    """What to run."""

    missions: tuple[str, ...] = ("OutAndBack", "Survey")
    """Missions."""
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    """Conditions."""
    agents: tuple[str, ...] = ("dmax_adaptive", "dmax_belief", "planner")
    """Agents of evaluate.py that ship."""
    episodes: int = 2000
    """Episodes of each."""
    seed: int = 0
    """Seed that the episodes follow from, as in evaluate.py."""
    optimum: int = 0
    """Episodes whose optimum is found."""
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
    unknown = [name for name in args.conditions if name not in CONDITIONS]
    if unknown or args.episodes < 2 or args.seed < 0 or not 0 <= args.optimum <= args.episodes:
        raise OptionError(
            f"give --conditions of {'; '.join(CONDITIONS)}, at least 2 --episodes, no more --optimum, and a --seed of "
            "0 or more"
        )
    if any(name not in AGENTS for name in args.agents):
        raise AgentError(f"give --agents of {', '.join(AGENTS)}")
    console, rows, curves = Console(width=180), list[dict[str, Any]](), list[dict[str, Any]]()
    seeds = episode_seeds(args.seed, args.episodes)
    for mission in args.missions:
        found: Found = {}
        for condition in args.conditions:
            options = Options(mission, **CONDITIONS[condition])
            agents = {name: [AGENTS[name](Request(known_of(options), None, 0))] for name in args.agents}
            runs = run_agents(agents, options, seeds, jobs=args.jobs)
            found[condition] = {name: one[0].episodes for name, one in runs.items()}
        optima = {name: one for name in args.conditions if (one := _optimum(args, mission, name))}
        rows += rows_of(mission, found, optima, args.seed)
        for condition in (one for one in COMPARED if one in found and "planner" in args.agents):
            curves += [
                {"mission": mission, "condition": condition, **one}
                for one in compare(args, Options(mission, **CONDITIONS[condition]), found[condition]["planner"])
            ]
    title = f"{args.episodes} episodes, episode_seeds({args.seed}, {args.episodes})"
    console.print(_conditions_table(f"{title}; optimum of the first {args.optimum}", rows))
    console.print(_curves_table(title, curves))
    console.print(_summary_table(rows, curves))
    content = {"episodes": args.episodes, "seed": args.seed, "optimum": args.optimum, "rows": rows, "curves": curves}
    write_whole(args.out / "conditions.json", json.dumps(content, indent=2) + "\n")


def _optimum(args: Args, mission: str, condition: str) -> Optimum | None:
    if not args.optimum:
        return None
    options = Options(mission, **CONDITIONS[condition])
    return solve(options, episode_seeds(args.seed, args.optimum), args.jobs)


def rows_of(mission: str, found: Found, optima: Mapping[str, Optimum], seed: int) -> list[dict[str, Any]]:
    """Figures of each condition and agent.

    Args:
        mission: Its name.
        found: Episodes, the same ones for all.
        optima: By condition, of the first of these episodes.
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
            if EXACT.get(condition) in found:
                row |= _share("of_exact", episodes.score, found[EXACT[condition]][name].score, seed)
            if condition in optima:
                first = episodes.score[: len(optima[condition].lower)]
                row |= _share("of_rollout", first, optima[condition].lower, seed)
                row |= _share("of_bound", first, optima[condition].upper, seed)
            rows.append(row)
    return rows


def _share(name: str, part: Array, whole: Array, seed: int) -> dict[str, Any]:
    """Mean over mean, with its paired interval."""
    if whole.mean() <= 0.0:
        return {name: None, f"{name}_ci95": None}
    means = Bootstrap({"part": part[None], "whole": whole[None]}, seed).means()
    some = means["whole"] > 0.0  # of very few episodes a resample may hold none that scored
    return {
        name: float(part.mean() / whole.mean()),
        f"{name}_ci95": interval(means["part"][some] / means["whole"][some]),
    }


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
    table = Table(title=title, box=box.SIMPLE_HEAD)
    left = ("mission", "condition", "agent")
    shares = {"of_exact": "of exact (95 %)", "of_rollout": "of the rollout (95 %)", "of_bound": "of the bound (95 %)"}
    for heading in (*left, "score", "stranded (95 %)", *shares.values()):
        table.add_column(heading, justify="left" if heading in left else "right")
    for row in rows:
        low, high = row["stranded_ci95"]
        table.add_row(
            *(row[name] for name in left), f"{row['score_mean']:.4g}",
            f"{row['stranded_rate']:.2%} ({low:.2%} to {high:.2%})",
            *(_rate(row.get(name), row.get(f"{name}_ci95")) for name in shares),
        )  # fmt: skip
    return table


def _curves_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(title=f"planner above rules at equal stranding, {title}", box=box.SIMPLE_HEAD)
    left = ("mission", "condition", "rule")
    for heading in (*left, "planner", "stranded", "rule's score there", "planner above it (95 %)"):
        table.add_column(heading, justify="left" if heading in left else "right")
    for _, group in itertools.groupby(rows, lambda row: (row["mission"], row["condition"])):
        ours = list(group)
        best = max(row["rule_score"] or 0.0 for row in ours)
        for row in ours:
            table.add_row(
                *(row[name] for name in left), f"{row['planner_score']:.4g}", f"{row['stranded_rate']:.2%}",
                "more strand" if row["rule_score"] is None else f"{row['rule_score']:.4g}",
                _rate(row["gain"], row["gain_ci95"], "+"), style="bold" if row["rule_score"] == best else "",
            )  # fmt: skip
    return table


def _summary_table(rows: Sequence[Mapping[str, Any]], curves: Sequence[Mapping[str, Any]]) -> Table:
    """What the planner is judged by, of each mission."""
    missions = list(dict.fromkeys(row["mission"] for row in rows))
    table = Table(title="planner (95 %)", box=box.SIMPLE_HEAD)
    for heading in ("", *missions):
        table.add_column(heading, justify="right" if heading else "left")
    for told, condition, share in (
        ("known, of the rollout", "known", "of_rollout"),
        ("uncertain, exact, still, of the rollout", "uncertain, exact, still", "of_rollout"),
        ("uncertain, of exact", "uncertain", "of_exact"),
    ):
        found = {
            row["mission"]: _rate(row.get(share), row.get(f"{share}_ci95"))
            for row in rows
            if (row["condition"], row["agent"]) == (condition, "planner")
        }
        table.add_row(told, *(found.get(mission, "") for mission in missions))
    for told, left_out in (("harsh, above the best rule", ""), ("the same without dmax_belief", "dmax_belief")):
        least: dict[str, Mapping[str, Any]] = {}
        for row in curves:
            if row["condition"] == "harsh" and row["rule"] != left_out and row["gain"] is not None:
                before = least.get(row["mission"], row)
                least[row["mission"]] = min(row, before, key=lambda one: float(one["gain"]))
        shown = (least.get(mission) for mission in missions)
        table.add_row(told, *("" if one is None else _rate(one["gain"], one["gain_ci95"], "+") for one in shown))
    return table


def _rate(share: float | None, ci95: Sequence[float] | None, sign: str = "") -> str:
    if share is None or ci95 is None:
        return ""
    return f"{share:{sign}.1%} ({ci95[0]:{sign}.1%} to {ci95[1]:{sign}.1%})"


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, AgentError, ClusterError, TaskError)))
