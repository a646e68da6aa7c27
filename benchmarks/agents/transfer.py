"""The policies that ship where they were not trained: another difficulty, another robot. The table of docs/learning.md.

`python benchmarks/agents/transfer.py` runs a rule, the planner and policies on the same episodes and prints score,
stranding and what ppo gains on the rule. OUT/transfer.json holds it; finished rows are kept: a run that was killed goes
on.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
from rich import box
from rich.console import Console
from rich.table import Table

from homeward import cli
from homeward.agents import AgentError, make_policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.learning.settings import STARTS
from homeward.agents.registry import shipped
from homeward.agents.trained.policy_file import WEIGHTS
from homeward.agents.trained.provenance import made_with
from homeward.envs.options import MISSIONS, OptionError, Options
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole

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
    file = args.out / "transfer.json"
    kept: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
    table = Table(title=f"{args.episodes} episodes a row, seed {args.seed}", box=box.SIMPLE_HEAD)
    for heading in ("mission", "met", *(f"{name}, stranded" for name in AGENTS), f"ppo minus {RULE} (95 %)"):
        table.add_column(heading)
    for mission, met in itertools.product(args.missions, ELSEWHERE):
        options = Options(mission, **ELSEWHERE[met])  # type: ignore[arg-type]
        files = [(shipped(mission, start) / WEIGHTS).read_bytes() for start in STARTS]
        weights = hashlib.sha256(b"".join(files)).hexdigest()
        common = {**made_with(options), "weights": weights, "episodes": args.episodes, "seed": args.seed}
        name = f"{mission}, {met}"
        if kept.get(name, {}).get("of") != common:
            kept[name] = {"of": common, **row_of(options, args.episodes, args.seed)}
            write_whole(file, json.dumps(kept, indent=2) + "\n")
        row = kept[name]
        cells = (f"{one['score']:.4g}, {one['stranded']:.1%}" for one in row["agents"].values())
        low, high = row["gain_ci95"]
        table.add_row(mission, met, *cells, f"{row['gain']:+.3g} ({low:+.3g} to {high:+.3g})")
    Console().print(table)


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
