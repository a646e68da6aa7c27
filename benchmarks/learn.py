"""Train over missions and seeds, and compare with the rules: the tables and the picture of docs/learning.md.

`python benchmarks/learn.py` trains with the defaults of train.py and prints how the policies do on unseen episodes;
`--ablation` leaves out or changes one part of the recipe at a time. Finished runs are kept, and a killed one goes on
from its last checkpoint. OUT/learn.json holds the figures, OUT/learn.png the learning curves.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own
import train
from homeward import cli
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import stratified_means, wilson
from homeward.agents.learning.curve import EPISODES, SEED, Point, read_curve
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.agents.oracle import solve
from homeward.agents.registry import AGENTS, Request
from homeward.agents.trained.policy_file import load_policy
from homeward.envs import IDS
from homeward.envs.options import OptionError, Options, known_of
from homeward.files import write_whole

RULES = ("soc50", "dmax", "dmax_mapped", "dmax_adaptive")
RECIPE = "recipe"
ABLATION: dict[str, dict[str, Any]] = {
    RECIPE: {},
    "from dmax_adaptive": {"guide": "dmax_adaptive"},
    "from nothing": {"guide": "none"},
    "critic without insight": {"insight": False},
    "no shaping": {"shaping": "none"},
    "stranding costs the score only": {"stranding_cost": 0.0},
    "stranding costs two good scores": {"stranding_cost": 2.0},
    "ten times the learning rate": {"learning_rate": 1e-3},
}
"""What to change in the recipe, of the arguments of train.py."""
_RESAMPLES = 2000
_LEAST_GAP = 0.001
"""Share of the optimum that the best rule has to miss for there to be a gap to close."""
_WIDTH = 150  # columns of the table
_CHECKPOINT_S = 60.0


@dataclass(frozen=True)
class Args:
    """What to train and on how many episodes to compare."""

    out: Path = Path("runs/learn")
    """Folder of the runs and the results."""
    missions: tuple[str, ...] = ("Survey", "OutAndBack", "Patrol")
    """Missions to train for."""
    difficulties: tuple[str, ...] = ("uncertain",)
    """Difficulties to train for."""
    seeds: int = 5
    """Training seeds: 0, 1, ..."""
    steps: int | None = None
    """Decisions to train on; by default those of train.py."""
    episodes: int = 2000
    """Unseen episodes to compare on."""
    optimum: int = 0
    """Episodes, of the same, to compare with the optimum with full knowledge, too."""
    jobs: int = 2
    """Processes that find the optimum."""
    ablation: bool = False
    """Change one part of the recipe at a time."""


@dataclass(frozen=True)
class Result:
    """What came of one recipe: rows of policies trained with one seed each, and the best rule on the same episodes."""

    mission: str
    difficulty: str
    variant: str
    score: NDArray[np.float64]  # (seeds, episodes)
    stranded: NDArray[np.bool_]  # (seeds, episodes)
    curves: tuple[list[Point], ...]
    rule: str
    rule_score: NDArray[np.float64]  # (episodes,)
    rule_stranded: NDArray[np.bool_]
    rule_on_curve: float  # its mean score on the episodes of curves
    optimum: NDArray[np.float64] | None  # lower bounds of the first episodes


def main(args: Args) -> list[Result]:
    """Train, compare, print the table and write the files.

    Raises:
        TrainingError, OptionError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.seeds < 1 or args.episodes < 2:
        raise TrainingError(f"--seeds {args.seeds} --episodes {args.episodes}: give at least 1 seed and 2 episodes")
    variants = ABLATION if args.ablation else {RECIPE: {}}
    results = [
        compare(args, mission, difficulty, name, changes)
        for mission in args.missions
        for difficulty in args.difficulties
        for name, changes in variants.items()
    ]
    rows = [summary(result) for result in results]
    write_whole(args.out / "learn.json", json.dumps(rows, indent=2) + "\n")
    write_whole(args.out / "learn.png", curves_png(results))
    console = Console(width=_WIDTH)
    console.print(table(rows, args))
    if len(args.missions) > 1 and not args.ablation:
        for difficulty in args.difficulties:
            console.print(over_missions([result for result in results if result.difficulty == difficulty]))
    return results


def over_missions(results: list[Result]) -> str:
    """The mean over missions of what the policies gain on the best rule, as a share of its score."""
    gains = {one.mission: (one.score - one.rule_score) / one.rule_score.mean() for one in results}
    low, high = _middle(stratified_means(gains, 0))
    mean = np.mean([gain.mean() for gain in gains.values()])
    return (
        f"{results[0].difficulty}, mean over {', '.join(gains)}: {mean:+.1%} of the best rule's score "
        f"({low:+.1%} to {high:+.1%}, stratified bootstrap)"
    )


def compare(args: Args, mission: str, difficulty: str, variant: str, changes: Mapping[str, Any]) -> Result:
    """Train one recipe with all seeds and run the policies and the rules."""
    options = Options(mission, difficulty=difficulty)
    seeds = tuple(episode_seeds(0, args.episodes))
    folders = [trained(args, mission, difficulty, variant, changes, seed) for seed in range(args.seeds)]
    known = known_of(options)
    runs = [run_episodes(load_policy(folder, known), options, seeds).episodes for folder in folders]
    rule, of_rule = best_rule(options, seeds)
    return Result(
        mission, difficulty, variant,
        np.stack([run.score for run in runs]), np.stack([run.stranded for run in runs]),
        tuple(read_curve(folder) for folder in folders),
        rule, of_rule.score, of_rule.stranded,
        float(of(rule, options, tuple(episode_seeds(SEED, EPISODES))).score.mean()),
        optimum(options, seeds[: args.optimum], args.jobs) if args.optimum else None,
    )  # fmt: skip


def trained(args: Args, mission: str, difficulty: str, variant: str, changes: Mapping[str, Any], seed: int) -> Path:
    """Train one policy, or find it trained, and return its folder."""
    name = "-".join((mission, difficulty, variant.replace(" ", "_"), str(seed)))
    Console(stderr=True).print(f"{name}: training", markup=False, highlight=False)
    recipe = train.Args(
        env=IDS[mission], out=args.out / name, difficulty=difficulty, seed=seed, resume=True, checkpoint_s=_CHECKPOINT_S
    )
    if args.steps is not None:
        recipe = dataclasses.replace(recipe, steps=args.steps)
    of_ppo = {name: value for name, value in changes.items() if hasattr(PPOSettings, name)}
    others = {name: value for name, value in changes.items() if name not in of_ppo}
    return train.main(dataclasses.replace(recipe, ppo=dataclasses.replace(recipe.ppo, **of_ppo), **others))


@functools.cache
def of(rule: str, options: Options, seeds: tuple[int, ...]) -> Episodes:
    """Episodes of a rule."""
    policy = AGENTS[rule](Request(known_of(options), None, 0))
    return run_episodes(policy, options, seeds).episodes


def best_rule(options: Options, seeds: tuple[int, ...]) -> tuple[str, Episodes]:
    """The rule with the highest mean score, and its episodes."""
    rule = max(RULES, key=lambda name: float(of(name, options, seeds).score.mean()))
    return rule, of(rule, options, seeds)


@functools.cache
def optimum(options: Options, seeds: tuple[int, ...], jobs: int) -> NDArray[np.float64]:
    """Scores that the oracle reaches with full knowledge."""
    return solve(options, seeds, jobs).lower


def summary(result: Result) -> dict[str, Any]:
    """Figures of a recipe, for the table and `learn.json`."""
    gain = result.score - result.rule_score
    low, high = interval(gain)
    stranded, count = int(result.stranded.sum()), result.stranded.size
    row = {
        "mission": result.mission, "difficulty": result.difficulty, "variant": result.variant,
        "seeds": len(result.score), "episodes": result.score.shape[1],
        "score": float(result.score.mean()), "score_by_seed": result.score.mean(axis=1).tolist(),
        "rule": result.rule, "rule_score": float(result.rule_score.mean()),
        "gain": float(gain.mean()), "gain_ci95": [low, high],
        "stranded_rate": stranded / count, "stranded_ci95": wilson(stranded, count),
        "rule_stranded_rate": float(result.rule_stranded.mean()),
        "reaches_rule_s": [reached_s(curve, result.rule_on_curve) for curve in result.curves],
        "final_level_s": [reached_s(curve, 0.99 * curve[-1].score) for curve in result.curves],
        "trained_s": [curve[-1].trained_s for curve in result.curves],
        "optimum": None, "gap_closed": None, "gap_closed_ci95": None,
    }  # fmt: skip
    if result.optimum is not None:
        part = slice(0, len(result.optimum))
        gap = result.optimum - result.rule_score[part]
        row["optimum"] = {
            "episodes": len(gap),
            "score": float(result.optimum.mean()),
            "rule_score": float(result.rule_score[part].mean()),
        }
        if gap.mean() > _LEAST_GAP * result.optimum.mean():
            row["gap_closed"] = float(gain[:, part].mean() / gap.mean())
            row["gap_closed_ci95"] = gap_closed_interval(gain[:, part], gap)
    return row


def interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % percentile interval of the mean of (seeds, episodes), both resampled."""
    return _middle(_resampled(values))


def gap_closed_interval(gain: NDArray[np.float64], gap: NDArray[np.float64]) -> tuple[float, float]:
    """The same of the mean of (seeds, episodes) over that of (episodes,), both of the same episodes at each draw."""
    return _middle(_resampled(gain) / _resampled(np.broadcast_to(gap, gain.shape)))


def _resampled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of resampled seeds and episodes: the same ones for all values of one shape."""
    rng = np.random.default_rng(0)
    seeds, episodes = values.shape
    by_seed = rng.multinomial(seeds, np.full(seeds, 1.0 / seeds), _RESAMPLES) / seeds
    by_episode = rng.multinomial(episodes, np.full(episodes, 1.0 / episodes), _RESAMPLES) / episodes
    return np.asarray(np.einsum("rs,se,re->r", by_seed, values, by_episode, optimize=True))


def _middle(means: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def reached_s(curve: list[Point], score: float) -> float | None:
    """Seconds of training until a curve first reaches a score, `None` if it never does."""
    return next((point.trained_s for point in curve if point.score >= score), None)


def table(rows: list[dict[str, Any]], args: Args) -> Table:
    """One line a recipe."""
    shown = Table(title=f"PPO on {args.episodes} unseen episodes, {args.seeds} training seeds", box=box.SIMPLE_HEAD)
    for heading in (
        "mission", "variant", "score", "best rule", "minus best rule (95 %)", "stranded (95 %)", "rule stranded",
        "gap closed (95 %)", "reaches rule, s", "1 % of final, s", "trained, s",
    ):  # fmt: skip
        shown.add_column(heading, justify="left" if heading in ("mission", "variant") else "right")
    for row in rows:
        low, high = row["gain_ci95"]
        least, most = row["stranded_ci95"]
        shown.add_row(
            f"{row['mission']}\n{row['difficulty']}",
            row["variant"],
            f"{row['score']:.4g}",
            f"{row['rule_score']:.4g}\n{row['rule']}",
            f"{row['gain']:+.3g}\n({low:+.3g} to {high:+.3g})",
            f"{row['stranded_rate']:.2%}\n({least:.2%} to {most:.2%})",
            f"{row['rule_stranded_rate']:.2%}",
            gap_cell(row),
            *(median_s(row[name]) for name in ("reaches_rule_s", "final_level_s", "trained_s")),
        )
    return shown


def gap_cell(row: dict[str, Any]) -> str:
    """Share of the gap to the optimum that is closed, and its interval."""
    if row["optimum"] is None:
        return ""
    if row["gap_closed"] is None:
        return "no gap"
    low, high = row["gap_closed_ci95"]
    return f"{row['gap_closed']:.1%}\n({low:.1%} to {high:.1%})"


def median_s(times: list[float | None]) -> str:
    """Median time, with the number of seeds that got there at all where some did not."""
    there = [time for time in times if time is not None]
    if not there:
        return "never"
    return f"{np.median(there):.0f}" + ("" if len(there) == len(times) else f" ({len(there)} of {len(times)})")


def curves_png(results: list[Result]) -> bytes:
    """Score over training time, a line a seed, beside the best rule."""
    groups = list(dict.fromkeys((result.mission, result.difficulty) for result in results))
    figure = Figure(figsize=(4.0 * len(groups), 3.2), layout="constrained")
    for axes, group in zip(np.atleast_1d(figure.subplots(1, len(groups))), groups, strict=True):
        own = [result for result in results if (result.mission, result.difficulty) == group]
        for index, result in enumerate(own):
            for curve in result.curves:
                label = result.variant if curve is result.curves[0] else None
                minutes, scores = [p.trained_s / 60.0 for p in curve], [p.score for p in curve]
                axes.plot(minutes, scores, color=f"C{index}", linewidth=1.0, label=label)
        axes.axhline(own[0].rule_on_curve, color="black", linestyle="--", linewidth=1.0, label=own[0].rule)
        axes.set(title=", ".join(group), xlabel="training, minutes", ylabel="score")
        axes.set_ylim(bottom=0.75 * own[0].rule_on_curve)
        axes.legend(fontsize="small")
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (TrainingError, OptionError), interrupted="the same command goes on")


if __name__ == "__main__":
    sys.exit(run())
