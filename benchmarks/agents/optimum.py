"""How close the oracle's two figures are, and what share of the optimum the rules reach: the tables of docs/optimum.md.

`python benchmarks/agents/optimum.py` solves 500 episodes of each mission and runs the agents on the same ones. Episodes
that were solved by the same code are kept, so that a killed run goes on where it was.
"""

from __future__ import annotations

import platform
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.kept import Kept
from benchmarks.tables import rate, table
from homeward import cli
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.oracle import OracleError, solve
from homeward.agents.registry import AGENTS, Request
from homeward.envs.options import OptionError, Options, known_of
from homeward.parallel import ClusterError, run_tasks

TOGETHER = 10
"""Episodes that are solved together, and kept."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Args:
    """What to solve, and how."""

    out: Path = Path("runs/optimum")
    """Folder of the episodes that are solved."""
    missions: tuple[str, ...] = ("OutAndBack", "Survey", "Patrol")
    """Missions."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    instruments: str | None = None
    """exact, meter, gauge or a TOML file; those of the difficulty if left out."""
    weather: str | None = None
    """still or changing; that of the difficulty if left out."""
    episodes: int = 500
    """Episodes of each mission."""
    seed: int = 0
    """Seed that the episodes follow from, as in evaluate.py."""
    jobs: int = 2
    """Processes at once."""
    agents: tuple[str, ...] = ("soc50", "dmax", "dmax_mapped", "dmax_adaptive", "planner")
    """Agents to compare with the optimum."""


def main(args: Args) -> None:
    """Solve, run the agents and print.

    Raises:
        OptionError, OracleError, ClusterError: An argument cannot be used.
        OSError: The folder cannot be written to.
    """
    if args.episodes < 2 or args.seed < 0:
        raise OptionError(f"--episodes {args.episodes} --seed {args.seed}: give at least 2 and a seed of 0 or more")
    used = ", ".join(f"{name} {version(name)}" for name in ("homeward", "numpy", "numba", "scipy", "gymnasium"))
    given = (("instruments", args.instruments), ("weather", args.weather))
    conditions = ", ".join([args.difficulty, *(f"{name} {value}" for name, value in given if value)])
    bounds = table(
        f"{args.episodes} episodes, {conditions}, seed {args.seed}: rollout over bound", ("mission",),
        ("rollout", "bound", "mean", "least", "1 %", "10 %", "median", "CPU s an episode"),
    )  # fmt: skip
    bounds.caption = f"Python {platform.python_version()}, {used}"
    shares = table(
        "Agents on the same episodes", ("mission", "agent"),
        ("score", "of the rollout", "of the bound", "stranded (95 %, Wilson)", "us"),
    )  # fmt: skip
    for mission in args.missions:
        options = Options(mission, difficulty=args.difficulty, instruments=args.instruments, weather=args.weather)
        lower, upper, cpu_s = solved(args, options)
        _add_bounds(bounds, mission, lower, upper, cpu_s)
        _add_shares(shares, args, options, lower, upper)
    console = Console()
    console.print(bounds)
    console.print(shares)


def solved(args: Args, options: Options) -> tuple[Array, Array, Array]:
    """Lower and upper figure of each episode and the processor time that it took, s; each of shape (episodes,)."""
    given = (options.mission, options.difficulty, options.instruments, options.weather)
    name = "-".join(str(one).replace("/", "_") for one in given if one is not None)
    kept, seeds = Kept(args.out / f"{name}.json", seed=args.seed), episode_seeds(args.seed, args.episodes)
    parts = [(i, min(i + TOGETHER, args.episodes)) for i in range(0, args.episodes, TOGETHER)]
    tasks = {f"{first} to {last - 1}": (options, seeds[first:last]) for first, last in parts}
    run_tasks(_solve, kept.missing(tasks), jobs=args.jobs, keep=kept.keep, title=f"{options.mission}: optimum")
    lower, upper, cpu_s = (
        np.array([value for name in tasks for value in kept.results[name][key]]) for key in ("lower", "upper", "cpu_s")
    )
    return lower, upper, cpu_s


def _solve(task: tuple[Options, list[int]]) -> dict[str, Any]:
    options, seeds = task
    solve(options, seeds[:1])  # compiles, where that is not done yet
    start = time.process_time()
    optimum = solve(options, seeds)
    each_s = (time.process_time() - start) / len(seeds)
    return {"lower": optimum.lower.tolist(), "upper": optimum.upper.tolist(), "cpu_s": [each_s] * len(seeds)}


def _add_bounds(bounds: Table, mission: str, lower: Array, upper: Array, cpu_s: Array) -> None:
    ratio = np.divide(lower, upper, out=np.ones_like(lower), where=upper > 0.0)
    shown = (ratio.mean(), *np.quantile(ratio, [0.0, 0.01, 0.1, 0.5]))
    means = (f"{lower.mean():.5g}", f"{upper.mean():.5g}")
    bounds.add_row(mission, *means, *(f"{100.0 * one:.2f} %" for one in shown), f"{cpu_s.mean():.2f}")


def _add_shares(shares: Table, args: Args, options: Options, lower: Array, upper: Array) -> None:
    for name in args.agents:
        policy = AGENTS[name](Request(known_of(options), None, args.seed))
        run = run_episodes(policy, options, episode_seeds(args.seed, args.episodes))
        mean, stranded = run.episodes.score.mean(), int(run.episodes.stranded.sum())
        of_optimum = (f"{mean / one.mean():.1%}" for one in (lower, upper))
        stranded_rate = rate(stranded, args.episodes, ".1%")
        shares.add_row(options.mission, name, f"{mean:.5g}", *of_optimum, stranded_rate, f"{run.decision_us:.2g}")


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, OracleError, ClusterError)))
