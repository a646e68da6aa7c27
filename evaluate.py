"""Compare agents on the same episodes.

`python evaluate.py --env homeward/Survey-v0 --agents soc50 dmax_adaptive+shield ppo=FOLDER --out
DIR` writes DIR/evaluation.json, DIR/episodes.csv (one row per agent, training seed and episode),
and plots: scores.png, profiles.png, one episode over time (episode.png) and over the route
(route.png), and learning.png if an agent has a learning curve. An agent is NAME, NAME+shield or
NAME=FILE, with a label of its own as LABEL:NAME=FILE.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import homeward  # noqa: F401 - first: it says in a line what is not installed

# isort: split
import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from homeward import cli
from homeward.agents import AGENTS, AgentError, Policy, make_policy
from homeward.agents.evaluation import episode_seeds
from homeward.agents.evaluation.episode_plots import episode_png, route_png
from homeward.agents.evaluation.learning_curve import (
    EvaluatedCurve,
    best_so_far,
    point_of,
    read_curve,
)
from homeward.agents.evaluation.learning_plot import learning_png
from homeward.agents.evaluation.plots import profiles_png, scores_png
from homeward.agents.evaluation.summary import Evaluation, Optima
from homeward.agents.evaluation.tasks import run_agents
from homeward.agents.evaluation.tradeoff import LEVELS as EQUAL
from homeward.agents.evaluation.tradeoff import Curve, curve_of, margins_png
from homeward.agents.learning.settings import TrainingError
from homeward.agents.registry import SWEPT
from homeward.agents.shield import Shield
from homeward.agents.trained.policy_file import DESCRIPTION, NetworkPolicy
from homeward.agents.trained.provenance import differences
from homeward.agents.trained.run_folder import CURVE_POLICIES, RUN
from homeward.envs import IDS
from homeward.envs.options import OptionError, Options
from homeward.envs.routes import RouteError
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole
from homeward.parallel import ClusterError, TaskError, check_workers
from homeward.physics import RobotError

SHIELDED = "+shield"
"""Suffix of the name of an agent with a shield."""

_RISKS = tuple(10.0**-k for k in range(1, 9))
"""Risks of the shield that are tried with --margins. Chosen: decades about the default
(`homeward.agents.shield`)."""
_MOST_EPISODES = 1_000_000
"""Chosen: intervals are a hundredth as wide as those of 100 episodes, and all results fit into
memory."""


@dataclass(frozen=True)
class Args:
    """Agents, environment and output."""

    agents: tuple[str, ...] = ("soc50", "dmax", "dmax_mapped", "dmax_adaptive")
    """Agents: random, soc50, dmax, dmax_mapped, dmax_adaptive, dmax_belief, planner, ppo,
    ppo_scratch (the last two as shipped, or ppo=FOLDER; for several training seeds
    ppo=FOLDER,FOLDER or a folder of them), also NAME+shield. LABEL:NAME or LABEL:ppo=FOLDER gives a
    label of one's own to tables and plots."""
    env: str = "homeward/Survey-v0"
    """Environment id."""
    episodes: int = 500
    """Number of episodes, the same for all agents."""
    seed: int = 0
    """Seed of the episodes; they differ from those of training."""
    out: Path = Path("runs/evaluation")
    """Folder for evaluation.json, episodes.csv and the plots."""
    difficulty: str = "uncertain"
    """known, uncertain or harsh."""
    instruments: str | None = None
    """exact, meter, gauge, any_gauge or a TOML file with sizes of errors; by default that of the
    difficulty."""
    weather: str | None = None
    """still or changing; by default that of the difficulty."""
    robot: str = "rusti_computer"
    """Preset name or TOML file."""
    route: str = "generated"
    """generated, hidden_wind, the name or path of a CSV profile, or a track: .gpx, .fit or CSV with
    positions."""
    action_type: str = "discrete"
    """discrete or continuous."""
    decision_s: float | None = None
    """Time between decisions, s; by default a 200th of the time that the battery lasts."""
    randomise: str = "generic"
    """generic (robots within the ranges of the difficulty) or file (drawn with the uncertainty in
    the robot's file)."""
    docks: str = ""
    """Charging docks, POSITION:POWER,...: metres along the route and watts, such as 0:15,120:20."""
    time_limit: float | None = None
    """Time limit of a mission, s; by default twice the time that the battery lasts. Docks need
    one."""
    optimum: bool = False
    """Also find the optimum of every episode with full knowledge, as two bounds: takes seconds per
    episode."""
    margins: bool = False
    """Also vary the reserve of every agent that has one (shielded ones: the risk), and compare at
    equal stranding: margins.json and margins.png."""
    jobs: int = 1
    """Processes on this machine: each runs one agent of one training seed on up to 512 episodes."""
    cluster: str | None = None
    """HOST:PORT of a Ray cluster to use instead; nothing has to be shared with it."""


def main(args: Args) -> Evaluation:
    """Run all agents, write the files and print the table.

    Raises:
        AgentError, TrainingError, OptionError, RobotError, RouteError: An argument is invalid.
        ClusterError: The cluster cannot be reached.
        TaskError: An agent failed.
        OSError: The output folder cannot be written to.
    """
    options = _options(args)
    env = HomewardVectorEnv(**vars(options))
    asked = _named(args.agents)
    bare: dict[str, list[Policy]] = {}
    for label, agent in asked.items():
        bare[label] = [make_policy(agent.name, env, file, args.seed) for file in agent.files]
    _warn_of_transfer(bare, args.env, env)
    seeds = episode_seeds(args.seed, args.episodes)
    if args.optimum:
        _check_optimum(options)
    check_workers(args.jobs, args.cluster)
    args.out.mkdir(parents=True, exist_ok=True)
    optimum = None
    if args.optimum:
        optimum = _optimum(args, options, seeds)
    # The bare policies are kept: the warning and the learning curves ask whether they are trained
    # ones.
    agents: dict[str, Sequence[Policy]] = dict(bare)
    for label, agent in asked.items():
        if agent.shielded:
            agents[label] = [Shield(policy, env.batch.known) for policy in bare[label]]
    runs = run_agents(agents, options, seeds, jobs=args.jobs, cluster=args.cluster)
    evaluation = Evaluation(args.env, options, args.seed, seeds, runs, optimum)
    rng = np.random.default_rng(args.seed)
    summary = evaluation.summary(rng)
    files: dict[str, str | bytes] = {
        "episodes.csv": evaluation.to_csv(),
        "scores.png": scores_png(evaluation, summary),
        "profiles.png": profiles_png(evaluation, summary, rng),
        "episode.png": episode_png(evaluation),
        "route.png": route_png(evaluation),
        "evaluation.json": evaluation.to_json(summary),
    }
    learning_curves = _learning_curves(args, asked, bare, env, seeds)
    if learning_curves:
        files["learning.png"] = learning_png(evaluation, summary, learning_curves)
    curves: dict[str, Curve] = {}
    if args.margins:
        curves = _margins(args, asked, env, seeds)
        files |= _margin_files(args, options.mission, curves)
    for name, content in files.items():
        write_whole(args.out / name, content)
    _print(summary, args.out, list(files))
    if args.margins:
        _print_margins(curves)
    return evaluation


def _margins(
    args: Args, asked: Mapping[str, Asked], env: HomewardVectorEnv, seeds: Sequence[int]
) -> dict[str, Curve]:
    """Every agent with several reserves, on the same episodes."""
    curves = {}
    for label, agent in asked.items():
        reserves: tuple[float | None, ...] = SWEPT.get(agent.name, (None,))
        if agent.shielded:
            reserves = _RISKS
        agents: dict[str, Sequence[Policy]] = {}
        for reserve in reserves:
            # the risk of the shield, around the agent as it is tuned
            if agent.shielded and reserve is not None:
                bare = [make_policy(agent.name, env, file, args.seed) for file in agent.files]
                agents[str(reserve)] = [Shield(policy, env.batch.known, reserve) for policy in bare]
            else:
                agents[str(reserve)] = [
                    make_policy(agent.name, env, file, args.seed, reserve) for file in agent.files
                ]
        runs = run_agents(agents, env.batch.options, seeds, jobs=args.jobs, cluster=args.cluster)
        curves[label] = curve_of({reserve: runs[str(reserve)] for reserve in reserves})
    return curves


def _margin_files(args: Args, mission: str, curves: Mapping[str, Curve]) -> dict[str, str | bytes]:
    """Plot and numbers of the agents with several reserves, by name."""
    title = f"{args.env}, {args.difficulty}: {args.episodes} episodes, seed {args.seed}, by reserve"
    plain_curves = {name: dataclasses.asdict(curve) for name, curve in curves.items()}
    return {
        "margins.png": margins_png(curves, mission, title),
        "margins.json": json.dumps(plain_curves, indent=1),
    }


def _print_margins(curves: Mapping[str, Curve]) -> None:
    table = Table(title="best mean score at a stranding rate of at most", box=box.SIMPLE_HEAD)
    table.add_column("agent")
    for level in EQUAL:
        table.add_column(f"{level:.1%}", justify="right")
    for name, curve in curves.items():
        scores = (curve.at(level) for level in EQUAL)
        table.add_row(name, *(_number_or_dash(score) for score in scores))
    cli.Terminal().show(table)


def _options(args: Args) -> Options:
    missions = {env_id: mission for mission, env_id in IDS.items()}
    if args.env not in missions:
        raise OptionError(f"unknown env {args.env!r}; choose from {', '.join(missions)}")
    if not 1 <= args.episodes <= _MOST_EPISODES or args.seed < 0:
        episodes = f"--episodes {args.episodes} --seed {args.seed}"
        raise OptionError(
            f"{episodes}: give 1 to {_MOST_EPISODES:,} episodes and a seed of 0 or more"
        )
    return Options(
        missions[args.env],
        robot=args.robot,
        route=args.route,
        difficulty=args.difficulty,
        instruments=args.instruments,
        weather=args.weather,
        action_type=args.action_type,
        decision_s=args.decision_s,
        randomise=args.randomise,
        docks=args.docks,
        time_limit_s=args.time_limit,
    )


@dataclass(frozen=True)
class Asked:
    """A requested agent: its name, whether it is shielded, and the file of each training seed."""

    name: str
    shielded: bool
    files: tuple[str | None, ...]


def _named(requests: tuple[str, ...]) -> dict[str, Asked]:
    """Each agent under its label: the one given, or its name, or the whole argument if a name is
    given twice."""
    if not requests:
        raise AgentError(f"no agent given; choose from {', '.join(AGENTS)}")
    parsed = [_parsed(spec) for spec in requests]
    labels = [own_label or agent for own_label, agent, _ in parsed]
    agents = {}
    for spec, (own_label, agent, asked) in zip(requests, parsed, strict=True):
        label = own_label or agent
        if not own_label and labels.count(label) > 1:
            label = spec
        agents[label] = asked
    if len(agents) < len(requests):
        raise AgentError(f"an agent or a label is given twice: {' '.join(requests)}")
    return agents


def _parsed(spec: str) -> tuple[str, str, Asked]:
    """Label (empty without one), name with its suffix, and agent of an argument
    LABEL:NAME+shield=FILE,FILE."""
    labelled, equals, file = spec.partition("=")
    label, colon, agent = labelled.rpartition(":")
    if colon and not label:
        raise AgentError(f"{spec} has an empty label: give LABEL:NAME, or NAME alone")
    name = agent.removesuffix(SHIELDED)
    files: tuple[str | None, ...] = (None,)
    if equals:
        files = tuple(itertools.chain.from_iterable(map(_training_seeds, file.split(","))))
    return label, agent, Asked(name=name, shielded=name != agent, files=files)


def _training_seeds(folder: str) -> list[str]:
    """The folder of a policy, or those of the policies in it."""
    is_policy = any((Path(folder) / name).is_file() for name in (DESCRIPTION, RUN))
    if is_policy or not Path(folder).is_dir():
        return [folder]
    inside = [str(file.parent) for file in sorted(Path(folder).glob(f"*/{DESCRIPTION}"))]
    return inside or [folder]


def _learning_curves(
    args: Args,
    asked: Mapping[str, Asked],
    policies: Mapping[str, Sequence[Policy]],
    env: HomewardVectorEnv,
    seeds: Sequence[int],
) -> dict[str, list[EvaluatedCurve]]:
    """Learning curves of the policies that were given as folders of runs, on the missions of this
    evaluation."""
    curves: dict[str, list[EvaluatedCurve]] = {}
    for label, agent in asked.items():
        for file, policy in zip(agent.files, policies[label], strict=True):
            if not file or not isinstance(policy, NetworkPolicy):
                continue
            curve = _learning_curve(args, agent, file, env, seeds)
            if curve is not None:
                curves.setdefault(label, []).append(curve)
    return curves


def _learning_curve(
    args: Args, agent: Asked, file: str, env: HomewardVectorEnv, seeds: Sequence[int]
) -> EvaluatedCurve | None:
    """Learning curve of a run's folder, on the missions of this evaluation; None if it has none."""
    points = read_curve(Path(file))
    if not points:
        return None
    folders = [Path(file) / CURVE_POLICIES / str(point.steps) for point in points]
    if not all((point_folder / DESCRIPTION).is_file() for point_folder in folders):
        print(
            f"evaluate.py: {file} lacks policies of its learning curve, as older runs do: learning.png leaves it out",
            file=sys.stderr,
        )
        return None
    agents: dict[str, list[Policy]] = {}
    for point_folder in folders:
        policy = make_policy(agent.name, env, point_folder, args.seed)
        if agent.shielded:
            policy = Shield(policy, env.batch.known)
        agents[str(point_folder)] = [policy]
    runs = run_agents(agents, env.batch.options, seeds, jobs=args.jobs, cluster=args.cluster)
    present = [
        point_of(runs[str(point_folder)][0].episodes, point.steps, point.trained_s)
        for point_folder, point in zip(folders, points, strict=True)
    ]
    best_points = [
        dataclasses.replace(present[index], steps=point.steps)
        for index, point in zip(best_so_far(points), points, strict=True)
    ]
    return EvaluatedCurve(present, best_points)


def _check_optimum(options: Options) -> None:
    from homeward.agents.oracle import OracleError, check

    try:
        check(options)
    except OracleError as error:
        raise AgentError(f"--optimum: {error}") from None


def _optimum(args: Args, options: Options, seeds: Sequence[int]) -> Optima:
    from homeward.agents.oracle import solve

    optimum = solve(options, seeds, args.jobs, args.cluster)
    return Optima(optimum.lower, optimum.upper)


def _warn_of_transfer(
    agents: Mapping[str, Sequence[Policy]], env_id: str, env: HomewardVectorEnv
) -> None:
    for label, policies in agents.items():
        differing = [
            difference
            for policy in policies
            if isinstance(policy, NetworkPolicy)
            for difference in differences(
                policy.description, env_id, env.batch.options, env.batch.known
            )
        ]
        if differing:
            print(
                f"evaluate.py: warning: {label} meets {', '.join(dict.fromkeys(differing))}; its figures are those of "
                "a transfer",
                file=sys.stderr,
            )


def _print(summary: Mapping[str, Any], out: Path, files: Sequence[str]) -> None:
    reference = next(iter(summary["agents"]))
    table = Table(title=_title(summary), caption=_caption(summary), box=box.SIMPLE_HEAD)
    table.add_column("agent", overflow="fold", min_width=13)
    headings = ["score", "IQM", f"minus {reference}", "stranded", "late", "us"]
    if summary["optimum"]:
        headings.insert(3, "optimum")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, agent in summary["agents"].items():
        difference = summary["paired"].get(f"{name} - {reference}")
        minus_reference: str | Text = ""
        if difference:
            with_sign = functools.partial(_number, sign="+")
            minus_reference = _with_interval(difference["mean"], difference["ci95"], with_sign)
        cells: list[str | Text] = [
            _with_interval(agent["score_mean"], agent["score_ci95"], _number),
            _number(agent["score_iqm"]),
            minus_reference,
            _with_interval(agent["stranded_rate"], agent["stranded_ci95"], "{:.1%}".format),
            str(agent["timed_out"]),
            f"{agent['decision_us']:.2g}",
        ]
        if summary["optimum"]:
            cells.insert(3, _share_of_optimum(agent))
        table.add_row(name, *cells)
    console = cli.Terminal()
    console.show(table, ("us", "IQM", "late", "optimum", f"minus {reference}"))
    console.print(f"Written to {out}: {', '.join(files)}")


def _title(summary: Mapping[str, Any]) -> str:
    """Environment and options, in two lines, three with docks."""
    options = summary["options"]
    title = f"{summary['env']}, {summary['episodes']} episodes, seed {summary['seed']}\n"
    title += f"{options['difficulty']}, {options['robot']}, route {options['route']}, {options['action_type']} actions"
    if options["decision_s"]:
        title += f" every {options['decision_s']:g} s"
    if options["docks"]:
        title += f"\ndocks {options['docks']} (m:W)"
    if options["time_limit_s"]:
        title += f", time limit {options['time_limit_s']:g} s"
    return title


def _caption(summary: Mapping[str, Any]) -> str:
    """What the columns mean, and the versions of libraries."""
    caption = "below: 95 % intervals; late: out of time; us: microseconds a decision\n"
    if summary["optimum"]:
        caption += (
            f"optimum: share of the upper and of the lower bound, {_gap(summary['optimum'])}\n"
        )
    return caption + ", ".join(
        f"{library} {version}" for library, version in summary["versions"].items()
    )


def _number(value: float, sign: str = "") -> str:
    if abs(value) >= 100.0:
        return f"{value:{sign}.0f}"
    return f"{value:{sign}.3g}"


def _number_or_dash(value: float | None) -> str:
    if value is None:
        return "-"
    return _number(value)


def _share_of_optimum(agent: Mapping[str, Any]) -> str:
    """Share of the upper bound, and of the oracle's score: the true share lies between."""
    at_least = agent["share_of_optimum_at_least"]
    at_most = agent["share_of_optimum"]
    if at_least is None or at_most is None:
        return ""
    return f"{at_least:.0%} to\n{at_most:.0%}"


def _gap(optimum: Mapping[str, float]) -> str:
    """The bounds of the optimum, and how far they are apart."""
    lower = optimum["lower"]
    upper = optimum["upper"]
    bounds = f"{_number(upper)} and {_number(lower)}"
    if upper > 0.0:
        bounds += f", a gap of {1.0 - lower / upper:.1%}"
    return bounds


def _with_interval(value: float, ends: list[float] | None, write: Callable[[float], str]) -> Text:
    if ends is None:
        return Text.assemble(write(value))
    low, high = ends
    return Text.assemble(write(value), (f"\n{write(low)} {write(high)}", "dim"))


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    refused = (
        AgentError,
        TrainingError,
        OptionError,
        RobotError,
        RouteError,
        TaskError,
        ClusterError,
    )
    return cli.run(main, Args, __doc__, refused)


if __name__ == "__main__":
    sys.exit(run())
