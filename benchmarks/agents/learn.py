"""Train policies for all missions, starts and seeds, and compare them: tables of docs/results.md.

`python benchmarks/agents/learn.py` trains as train.py does, for as long as each mission needs. It
prints the scores of the first, the last and the best policy of the learning curve, greedy and
sampled, on unseen episodes, and those of rules and planner. Finished runs and episodes are stored,
and an interrupted run continues from its last checkpoint. OUT/learn.json contains the figures;
`evaluate.py --agents ppo=OUT/RUN` plots a run's learning curve.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numba
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))
import train
from benchmarks.tables import span, table
from homeward import cli
from homeward.agents.base import Observations, Policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.learning_curve import read_curve
from homeward.agents.evaluation.statistics import Bootstrap, interval, wilson
from homeward.agents.learning.settings import STARTS, PPOSettings, TrainingError
from homeward.agents.registry import AGENTS, Request
from homeward.agents.trained.policy_file import NetworkPolicy, load_policy
from homeward.agents.trained.provenance import made_with
from homeward.agents.trained.run_folder import FIRST, LAST
from homeward.envs import IDS
from homeward.envs.options import OptionError, Options, known_of
from homeward.files import write_whole

RULES = ("dmax", "dmax_mapped", "dmax_adaptive")
OTHERS = ("dmax_belief", "planner")
STEPS = {"OutAndBack": 2_000_000, "Survey": 3_000_000, "Patrol": 1_000_000}
"""Decisions to train on, where no other number is given."""


@dataclass(frozen=True)
class Args:
    """Training and comparison."""

    out: Path = Path("runs/learn")
    """Folder of the runs and the results."""
    missions: tuple[str, ...] = ("OutAndBack", "Survey", "Patrol")
    """Missions to train for."""
    starts: tuple[str, ...] = STARTS
    """What to start from: scratch, dmax."""
    seeds: int = 5
    """Training seeds: 0, 1, ..."""
    steps: int | None = None
    """Decisions to train on; by default 2 million for OutAndBack, 3 for Survey and 1 for Patrol."""
    episodes: int = 2000
    """Unseen episodes to compare on."""


@dataclass(frozen=True)
class Driven:
    """Score, 0 unless home, and whether it stranded, of each episode, shape (episodes,) or (seeds,
    episodes)."""

    score: NDArray[np.float64]
    stranded: NDArray[np.bool_]


@dataclass(frozen=True)
class Result:
    """Results of a mission and start: first policy, best and last of each seed, other agents on the
    same episodes."""

    mission: str
    start: str
    first: dict[str, Driven]  # greedy and sampled; of seed 0
    best: dict[str, Driven]  # greedy and sampled; rows of seeds
    last: dict[str, Driven]  # greedy and sampled; rows of seeds
    others: dict[str, Driven]  # rules, dmax_belief and the planner
    trained_s: list[float]  # of each seed

    @property
    def rule(self) -> str:
        """The d_max rule with the highest mean score, of the three that do not estimate the robot."""
        return max(RULES, key=lambda name: float(self.others[name].score.mean()))


@final
class Sampled(Policy):
    """Samples each action from the policy's distribution, as in training.

    Args:
        policy: Policy with a discrete action space.
        seed: Seed of the samples.
    """

    def __init__(self, policy: NetworkPolicy, seed: int) -> None:
        assert isinstance(policy.action_space, spaces.MultiDiscrete)
        self._policy = policy
        self._rng = np.random.default_rng(seed)

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        logits = self._policy.outputs(self._policy.seen(observations, begun))
        # Gumbel-max trick: the largest logit with Gumbel noise is a sample.
        return self._policy.choose(
            (logits + self._rng.gumbel(size=logits.shape)).astype(np.float32)
        )


def main(args: Args) -> list[Result]:
    """Train, compare, print the table and write the files.

    Raises:
        TrainingError, OptionError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.seeds < 1 or args.episodes < 2:
        raise TrainingError(
            f"--seeds {args.seeds} --episodes {args.episodes}: give at least 1 seed and 2 episodes"
        )
    numba.set_num_threads(1)  # steps are short: several threads would be slower
    results = [compare(args, mission, start) for mission in args.missions for start in args.starts]
    rows = [summary(result) for result in results]
    write_whole(args.out / "learn.json", json.dumps(rows, indent=2) + "\n")
    Console(width=210).print(table_of(rows, args))
    return results


def compare(args: Args, mission: str, start: str) -> Result:
    """Train from one start with all seeds, and run the policies, the rules and the planner."""
    options = Options(mission)
    known = known_of(options)
    seeds = episode_seeds(0, args.episodes)
    folders = [trained(args, mission, start, seed) for seed in range(args.seeds)]

    def both(folder: Path, seed: int) -> dict[str, Driven]:
        key = (folder / "policy.safetensors").read_bytes()
        greedy = driven(args, options, load_policy(folder, known), key + b"greedy", seeds)
        sampled = driven(
            args, options, Sampled(load_policy(folder, known), seed), key + b"sampled", seeds
        )
        return {"greedy": greedy, "sampled": sampled}

    other_agents = {}
    for name in (*RULES, *OTHERS):
        other_agents[name] = driven(
            args, options, AGENTS[name](Request(known)), name.encode(), seeds
        )
    return Result(
        mission=mission,
        start=start,
        first=both(folders[0] / FIRST, 0),
        best=stacked([both(folder, seed) for seed, folder in enumerate(folders)]),
        last=stacked([both(folder / LAST, seed) for seed, folder in enumerate(folders)]),
        others=other_agents,
        trained_s=[read_curve(folder)[-1].trained_s for folder in folders],
    )


def stacked(of_seeds: list[dict[str, Driven]]) -> dict[str, Driven]:
    """Results of several seeds on the same episodes, stacked: one row per seed."""
    results = {}
    for how in of_seeds[0]:
        score = np.stack([of_seed[how].score for of_seed in of_seeds])
        stranded = np.stack([of_seed[how].stranded for of_seed in of_seeds])
        results[how] = Driven(score, stranded)
    return results


def trained(args: Args, mission: str, start: str, seed: int) -> Path:
    """Train a policy unless it is already trained, and return its folder."""
    name = f"{mission}-{start}-{seed}"
    Console(stderr=True).print(f"{name}: training", markup=False, highlight=False)
    steps = args.steps or STEPS[mission]
    return train.main(
        train.Args(
            env=IDS[mission], out=args.out / name, seed=seed, steps=steps, resume=True,
            ppo=PPOSettings(start=start),
        )
    )  # fmt: skip


def driven(
    args: Args, options: Options, policy: Policy, key: bytes, seeds: Sequence[int]
) -> Driven:
    """Drive a policy on episodes, or load the stored results.

    Args:
        args: Contains the folder of stored results.
        options: Options of the environment.
        policy: The policy.
        key: Identity of the policy beside the code.
        seeds: Seeds of the episodes.
    """
    inputs = json.dumps(
        [vars(options), made_with(options), [str(seed) for seed in seeds]], default=str
    ).encode()
    file = args.out / "driven" / f"{hashlib.sha256(key + inputs).hexdigest()[:24]}.npz"
    if not file.is_file():
        episodes = run_episodes(policy, options, seeds).episodes
        content = io.BytesIO()
        np.savez_compressed(content, score=episodes.score, stranded=episodes.stranded)
        write_whole(file, content.getvalue())
    with np.load(file, allow_pickle=False) as stored:
        return Driven(stored["score"], stored["stranded"])


def summary(result: Result) -> dict[str, Any]:
    """Figures of a mission and start, for the table and `learn.json`."""
    greedy = result.best["greedy"]
    sampled = result.best["sampled"]
    stranded = int(greedy.stranded.sum())
    count = greedy.stranded.size
    row: dict[str, Any] = {
        "mission": result.mission, "start": result.start,
        "seeds": len(greedy.score), "episodes": greedy.score.shape[1], "rule": result.rule,
        "score": float(greedy.score.mean()), "score_by_seed": greedy.score.mean(axis=1).tolist(),
        "stranded_by_seed": greedy.stranded.mean(axis=1).tolist(),
        "stranded_rate": stranded / count, "stranded_ci95": wilson(stranded, count),
        "sampled": float(sampled.score.mean()), "sampled_stranded_rate": float(sampled.stranded.mean()),
        "trained_s": result.trained_s,
    }  # fmt: skip
    compared = {f"first_{how}": episodes for how, episodes in result.first.items()}
    compared |= {f"last_{how}": episodes for how, episodes in result.last.items()}
    compared |= result.others
    for name, episodes in compared.items():
        row[name] = float(episodes.score.mean())
        row[f"{name}_stranded_rate"] = float(episodes.stranded.mean())
    against = {
        "first": result.first["greedy"],
        "rule": result.others[result.rule],
        "planner": result.others["planner"],
    }
    last_score = result.last["greedy"].score
    scores = {"": greedy.score, "last": last_score}
    scores |= {name: episodes.score[None] for name, episodes in against.items()}
    means = Bootstrap(scores, np.random.default_rng(0)).means()
    for name, episodes in against.items():
        row[f"minus_{name}"] = float((greedy.score - episodes.score).mean())
        row[f"minus_{name}_ci95"] = interval(means[""] - means[name])
    for name in ("first", "rule"):
        row[f"last_minus_{name}"] = float((last_score - against[name].score).mean())
        row[f"last_minus_{name}_ci95"] = interval(means["last"] - means[name])
    return row


def table_of(rows: list[dict[str, Any]], args: Args) -> Table:
    """One line for each mission and start."""
    conditions = f"{args.episodes} unseen episodes, {args.seeds} training seeds"
    title = f"PPO on {conditions}; differences of the greedy policy, paired"
    right = (
        "first, greedy", "first, sampled", "last, greedy", "last, sampled", "best, greedy", "best, sampled",
        "last minus first (95 %)", "last minus best rule (95 %)", "best minus best rule (95 %)",
        "best minus planner (95 %)", "best, stranded (95 %)", "trained, s",
    )  # fmt: skip
    shown = table(title, ("mission", "start"), right)
    for row in rows:
        row["score_stranded_rate"] = row["stranded_rate"]
        scores = (
            f"{row[name]:.4g}\n{row[f'{name}_stranded_rate']:.1%}"
            for name in (
                "first_greedy",
                "first_sampled",
                "last_greedy",
                "last_sampled",
                "score",
                "sampled",
            )
        )
        compared = ("last_minus_first", "last_minus_rule", "minus_rule", "minus_planner")
        gains = (span(row[name], row[f"{name}_ci95"], "+.3g") for name in compared)
        stranded = span(row["stranded_rate"], row["stranded_ci95"], ".2%")
        trained_s = f"{np.median(row['trained_s']):.0f}"
        shown.add_row(row["mission"], row["start"], *scores, *gains, stranded, trained_s)
    return shown


if __name__ == "__main__":
    refused = (TrainingError, OptionError)
    sys.exit(cli.run(main, Args, __doc__, refused, interrupted="the same command goes on"))
