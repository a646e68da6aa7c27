"""Compare agents on the same episodes.

`python evaluate.py --env homeward/Survey-v0 --agents soc50 dmax_adaptive ppo=FOLDER --out DIR` writes
DIR/evaluation.json, DIR/episodes.csv (one row per agent and episode), DIR/scores.png and DIR/episode.png.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from homeward import cli
from homeward.agents import AGENTS, AgentError, Policy, make_policy
from homeward.agents.evaluation import Evaluation, episode_seeds, run_episodes
from homeward.agents.evaluation_plots import episode_png, scores_png
from homeward.agents.policy_file import NetworkPolicy
from homeward.agents.provenance import differences
from homeward.envs import IDS
from homeward.envs.options import OptionError, Options
from homeward.envs.routes import RouteError
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole
from homeward.physics import RobotError


@dataclass(frozen=True)
class Args:
    """What to compare, and where to write it."""

    agents: tuple[str, ...] = ("soc50", "dmax", "dmax_mapped", "dmax_adaptive")
    """Agents, each NAME or NAME=FILE: random, soc50, dmax, dmax_mapped, dmax_adaptive, ppo=FOLDER."""
    env: str = "homeward/Survey-v0"
    """Environment id."""
    episodes: int = 500
    """Number of episodes, the same for all agents."""
    seed: int = 0
    """Seed that the episodes follow from; it cannot meet those of training."""
    out: Path = Path("runs/evaluation")
    """Folder for evaluation.json, episodes.csv and the plots."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    robot: str = "rusti_computer"
    """Preset name or TOML file."""
    route: str = "generated"
    """generated, hidden_wind, the name or path of a CSV profile, or a track: .gpx, .fit or CSV with positions."""
    action_type: str = "discrete"
    """discrete or continuous."""
    decision_s: float | None = None
    """Time between decisions, s; by default a 200th of the time that the battery lasts."""


def main(args: Args) -> Evaluation:
    """Run all agents, write the files and print the table.

    Raises:
        AgentError, OptionError, RobotError, RouteError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    options = _options(args)
    env = HomewardVectorEnv(**vars(options))
    agents = {label: make_policy(name, env, file, args.seed) for label, (name, file) in _named(args.agents).items()}
    _warn_of_transfer(agents, args.env, env)
    seeds = episode_seeds(args.seed, args.episodes)
    args.out.mkdir(parents=True, exist_ok=True)
    runs = {}
    columns = (TextColumn("{task.description:<16}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        for label, policy in agents.items():
            task = bar.add_task(label, total=args.episodes)
            runs[label] = run_episodes(policy, options, seeds, functools.partial(bar.advance, task))
    evaluation = Evaluation(args.env, options, args.seed, seeds, runs)
    summary = evaluation.summary()
    files: dict[str, str | bytes] = {
        "episodes.csv": evaluation.to_csv(),
        "scores.png": scores_png(evaluation, summary),
        "episode.png": episode_png(evaluation),
        "evaluation.json": evaluation.to_json(summary),
    }
    for name, content in files.items():
        write_whole(args.out / name, content)
    _print(summary, args.out)
    return evaluation


def _options(args: Args) -> Options:
    missions = {env_id: mission for mission, env_id in IDS.items()}
    if args.env not in missions:
        raise OptionError(f"unknown env {args.env!r}; choose from {', '.join(missions)}")
    if args.episodes < 1 or args.seed < 0:
        raise OptionError(
            f"--episodes {args.episodes} --seed {args.seed}: give at least 1 episode and a seed of 0 or more"
        )
    return Options(
        missions[args.env],
        robot=args.robot,
        route=args.route,
        difficulty=args.difficulty,
        action_type=args.action_type,
        decision_s=args.decision_s,
    )


def _named(given: tuple[str, ...]) -> dict[str, tuple[str, str | None]]:
    """Name and file of each agent under its label: the name, or all that was given where a name comes twice."""
    if not given:
        raise AgentError(f"no agent given; choose from {', '.join(AGENTS)}")
    parsed = []
    for spec in given:
        name, equals, file = spec.partition("=")
        if name.endswith("+shield"):
            raise AgentError(f"{spec}: there is no shield yet in this version; leave out '+shield'")
        parsed.append((spec, name, file if equals else None))
    names = [name for _, name, _ in parsed]
    agents = {spec if names.count(name) > 1 else name: (name, file) for spec, name, file in parsed}
    if len(agents) < len(given):
        raise AgentError(f"an agent is given twice: {' '.join(given)}")
    return agents


def _warn_of_transfer(agents: Mapping[str, Policy], env_id: str, env: HomewardVectorEnv) -> None:
    for label, policy in agents.items():
        if isinstance(policy, NetworkPolicy):
            found = differences(policy.description, env_id, env.batch.options, env.batch.setting)
            if found:
                print(
                    f"evaluate.py: warning: {label} meets {', '.join(found)}; its figures are those of a transfer",
                    file=sys.stderr,
                )


def _print(summary: Mapping[str, Any], out: Path) -> None:
    first = next(iter(summary["agents"]))
    chosen = summary["options"]
    table = Table(
        title=f"{summary['env']}, {summary['episodes']} episodes, seed {summary['seed']}\n"
        f"{chosen['difficulty']}, {chosen['robot']}, route {chosen['route']}, {chosen['action_type']} actions"
        + (f" every {chosen['decision_s']:g} s" if chosen["decision_s"] else ""),
        caption="below: 95 % intervals; late: out of time; us: microseconds a decision\n"
        + ", ".join(f"{one} {which}" for one, which in summary["versions"].items()),
        box=box.SIMPLE_HEAD,
    )
    table.add_column("agent", overflow="fold", min_width=13)
    for heading in ("score", "IQM", f"minus {first}", "stranded", "late", "us"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, one in summary["agents"].items():
        difference = summary["paired"].get(f"{name} - {first}")
        table.add_row(
            name,
            _with_interval(one["score_mean"], one["score_ci95"], _number),
            _number(one["score_iqm"]),
            _with_interval(difference["mean"], difference["ci95"], functools.partial(_number, sign="+"))
            if difference
            else "",
            _with_interval(one["stranded_rate"], one["stranded_ci95"], "{:.1%}".format),
            str(one["timed_out"]),
            f"{one['decision_us']:.2g}",
        )
    console = Console()
    console.print(table)
    files = "evaluation.json, episodes.csv, scores.png, episode.png"
    console.print(f"Written to {out}: {files}", markup=False, highlight=False)


def _number(value: float, sign: str = "") -> str:
    return f"{value:{sign}.0f}" if abs(value) >= 100.0 else f"{value:{sign}.3g}"


def _with_interval(value: float, ends: list[float] | None, write: Callable[[float], str]) -> str:
    return write(value) if ends is None else f"{write(value)}\n[dim]{write(ends[0])} {write(ends[1])}[/dim]"


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (AgentError, OptionError, RobotError, RouteError))


if __name__ == "__main__":
    sys.exit(run())
