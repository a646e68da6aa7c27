"""What the shield keeps and what it costs: strandings and scores of policies with and without it.

`python benchmarks/agents/shield.py` runs every policy on the same episodes bare and shielded and prints the table of
docs/evaluation.md; OUT/shield.json holds it. Finished rows are kept, so that a run that was killed goes on. Scores of
OutAndBack are also given as shares of the planner's, with the first reserve from its own upwards with which no more
than 1 % of the same episodes strand.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.kept import Kept
from benchmarks.tables import span, table
from homeward import cli
from homeward.agents import AgentError, Policy
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval, wilson
from homeward.agents.planner import Planner
from homeward.agents.registry import AGENTS, Request
from homeward.agents.rules.reserves import RESERVES
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward, Wanderer
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.options import MISSIONS, Known, OptionError, Options, known_of
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND
from homeward.parallel import ClusterError, run_tasks

MOST_STRANDED = 0.01
"""Share of the planner's episodes that may strand where its score is what others are compared with."""
_DEVIATIONS_MORE = 12
"""Standard deviations, one by one, by which the planner's reserve is raised until few enough strand. Chosen."""
_COMPARED = "OutAndBack"
"""Mission whose scores are compared with the planner's: nothing but the turn counts there."""
RECKLESS: dict[str, Callable[[Known], Policy]] = {
    "onward": Onward,
    "wanderer": lambda known: Wanderer(known, np.random.default_rng(0)),
}


@dataclass(frozen=True)
class Args:
    """What to run."""

    policies: tuple[str, ...] = (*RECKLESS, "random", "soc50", "dmax_adaptive", "dmax_belief", "planner", "ppo")
    """Agents of evaluate.py that ship, onward (never turns back) and wanderer (nor does it; draws the rest)."""
    missions: tuple[str, ...] = tuple(MISSIONS)
    """Missions."""
    difficulties: tuple[str, ...] = DIFFICULTIES
    """Difficulties."""
    routes: tuple[str, ...] = (GENERATED, HIDDEN_WIND)
    """Routes: generated or hidden_wind."""
    episodes: int = 4000
    """Episodes of each row."""
    seed: int = 0
    """Seed that the episodes follow from, as in evaluate.py."""
    jobs: int = 1
    """Processes at once."""
    out: Path = Path("runs/shield")
    """Folder of the results."""


Task = tuple[str, Options, int, int]
"""A policy, or `reference`; the environment, number of episodes and seed."""


def policy_of(name: str, known: Known) -> Policy:
    """A policy by its name; those that draw do so alike with and without a shield.

    Raises:
        AgentError: The name is unknown, or no policy ships.
    """
    if name in RECKLESS:
        return RECKLESS[name](known)
    if name not in AGENTS:
        raise AgentError(f"unknown policy {name!r}; choose from {', '.join((*RECKLESS, *AGENTS))}")
    return AGENTS[name](Request(known, None, 0))


def row_of(task: Task) -> dict[str, Any]:
    """One row of the table, or what its scores are compared with."""
    name, options, episodes, seed = task
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    known, seeds = known_of(options), episode_seeds(seed, episodes)
    if name == "reference":
        return reference_of(options, seeds)
    bare = run_episodes(policy_of(name, known), options, seeds).episodes
    safe = run_episodes(Shield(policy_of(name, known), known), options, seeds)
    means = Bootstrap({"bare": bare.score[None], "safe": safe.episodes.score[None]}, seed).means()
    return {
        "bare": _figures(bare),
        "shielded": _figures(safe.episodes) | {"decision_us": safe.decision_us},
        "difference": float(safe.episodes.score.mean() - bare.score.mean()),
        "difference_ci95": interval(means["safe"] - means["bare"]),
    }


def reference_of(options: Options, seeds: list[int]) -> dict[str, Any]:
    """The bare planner with the first reserve from its own upwards with which few enough strand; score 0 with none."""
    known, own = known_of(options), RESERVES["planner"][options.mission]
    for deviations in (own + more for more in range(_DEVIATIONS_MORE + 1)):
        figures = _figures(run_episodes(Planner(known, deviations), options, seeds).episodes)
        if figures["stranded"] <= MOST_STRANDED * len(seeds):
            return figures | {"deviations": deviations}
    return figures | {"score": 0.0, "deviations": deviations}


def _figures(episodes: Episodes) -> dict[str, Any]:
    return {"stranded": int(episodes.stranded.sum()), "score": float(episodes.score.mean())}


def main(args: Args) -> None:
    """Run all rows that are missing, keep each, and print the table.

    Raises:
        AgentError, OptionError, ClusterError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.episodes < 2 or args.seed < 0:
        raise OptionError(f"--episodes {args.episodes} --seed {args.seed}: give at least 2 and a seed of 0 or more")
    tasks = _tasks(args)
    for name, options, *_ in tasks.values():
        if name != "reference":
            policy_of(name, known_of(options))  # what cannot be made fails now, not after hours
    console, kept = Console(width=165), Kept(args.out / "shield.json", episodes=args.episodes, seed=args.seed)
    run_tasks(row_of, kept.missing(tasks), jobs=args.jobs, keep=kept.keep, title="rows")
    console.print(table_of(args, kept.results))
    console.print(
        "Of the planner: score over that of the bare planner with the least reserve at which no more than "
        f"{MOST_STRANDED:.0%} strand. Rates with Wilson's, differences with paired 95 % intervals.",
        highlight=False,
    )


def _tasks(args: Args) -> dict[str, Task]:
    settings = itertools.product(args.missions, args.difficulties, args.routes)
    return {
        _key(mission, difficulty, route, name): (
            name, Options(mission, difficulty=difficulty, route=route), args.episodes, args.seed,
        )
        for mission, difficulty, route in settings
        for name in (*(["reference"] if mission == _COMPARED else []), *args.policies)
    }  # fmt: skip


def _key(*parts: str) -> str:
    return ", ".join(parts)


def table_of(args: Args, rows: dict[str, Any]) -> Table:
    """The table, in the order of the arguments."""
    left = ("mission", "difficulty", "route", "policy")
    right = ("stranded (95 %)", "shielded (95 %)", "score", "shielded", "difference (95 %)", "of the planner")
    shown = table(f"{args.episodes} episodes a row, seed {args.seed}", left, right)
    for setting in itertools.product(args.missions, args.difficulties, args.routes):
        best = rows.get(_key(*setting, "reference"), {"score": 0.0})["score"]
        for name in args.policies:
            row = rows[_key(*setting, name)]
            bare, safe = row["bare"], row["shielded"]
            shown.add_row(
                *setting, name, _stranded(bare, args.episodes), _stranded(safe, args.episodes),
                f"{bare['score']:.4g}", f"{safe['score']:.4g}",
                span(row["difference"], row["difference_ci95"], "+.4g"),
                f"{safe['score'] / best:.1%}" if best else "",
            )  # fmt: skip
    return shown


def _stranded(figures: dict[str, Any], episodes: int) -> str:
    return "{} ({:.2%} to {:.2%})".format(figures["stranded"], *wilson(figures["stranded"], episodes))


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (AgentError, OptionError, ClusterError)))
