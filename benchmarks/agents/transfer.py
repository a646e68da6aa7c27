"""The policies that ship where they were not trained: another difficulty, another robot. The table of docs/learning.md.

`python benchmarks/agents/transfer.py` runs a rule, the planner and policies on the same episodes and prints score,
stranding and what ppo gains on the rule. OUT/transfer.json holds it; finished rows are kept: a run that was killed goes
on.
"""

from __future__ import annotations

import hashlib
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.kept import Kept
from benchmarks.tables import span, table
from homeward import cli
from homeward.agents import AgentError, make_policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.registry import SHIPPED
from homeward.agents.trained.policy_file import WEIGHTS
from homeward.envs.options import MISSIONS, OptionError, Options
from homeward.envs.vector import HomewardVectorEnv

RULE = "dmax_adaptive"
AGENTS = (RULE, "planner", "ppo", "ppo_scratch")
ELSEWHERE: dict[str, dict[str, str]] = {
    "known": {"difficulty": "known"},
    "harsh": {"difficulty": "harsh"},
    "husky": {"robot": "husky"},
}
"""What is not as it was in training, which was with `rusti_computer` at `uncertain`."""


@dataclass(frozen=True)
class Args:
    """On how many episodes to compare."""

    missions: tuple[str, ...] = tuple(MISSIONS)
    """Missions."""
    episodes: int = 1000
    """Episodes of each row."""
    seed: int = 7
    """Seed that the episodes follow from, as in evaluate.py."""
    out: Path = Path("runs/transfer")
    """Folder of the results."""


def main(args: Args) -> None:
    """Run what is missing, keep it, and print the table.

    Raises:
        AgentError, OptionError: A mission is not known.
        OSError: The output folder cannot be written to.
    """
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    weights = hashlib.sha256(b"".join(file.read_bytes() for file in sorted(SHIPPED.glob(f"*/{WEIGHTS}"))))
    kept = Kept(args.out / "transfer.json", episodes=args.episodes, seed=args.seed, weights=weights.hexdigest())
    figures = (*(f"{name}, stranded" for name in AGENTS), f"ppo minus {RULE} (95 %)")
    shown = table(f"{args.episodes} episodes a row, seed {args.seed}", ("mission", "met"), figures)
    for mission, met in itertools.product(args.missions, ELSEWHERE):
        name = f"{mission}, {met}"
        if name not in kept.results:
            options = Options(mission, **ELSEWHERE[met])  # type: ignore[arg-type]
            kept.keep(name, row_of(options, args.episodes, args.seed))
        row = kept.results[name]
        cells = (f"{one['score']:.4g}, {one['stranded']:.1%}" for one in row["agents"].values())
        shown.add_row(mission, met, *cells, span(row["gain"], row["gain_ci95"], "+.3g"))
    Console().print(shown)


def row_of(options: Options, episodes: int, seed: int) -> dict[str, Any]:
    """Score and rate of stranding of each agent, and the paired gain of ppo on the rule with its interval."""
    env, seeds = HomewardVectorEnv(**vars(options)), episode_seeds(seed, episodes)
    runs = {name: run_episodes(make_policy(name, env), options, seeds).episodes for name in AGENTS}
    means = Bootstrap({name: run.score[None] for name, run in runs.items()}, seed).means()
    return {
        "agents": {
            name: {"score": float(run.score.mean()), "stranded": float(run.stranded.mean())}
            for name, run in runs.items()
        },
        "gain": float(runs["ppo"].score.mean() - runs[RULE].score.mean()),
        "gain_ci95": interval(means["ppo"] - means[RULE]),
    }


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (AgentError, OptionError)))
