"""Train over seeds and settings, several runs at once, on this machine or on a Ray cluster.

`homeward sweep --seeds 0 1 2 --vary learning_rate=1e-3,3e-4 --jobs 2 --out runs/sweep` trains six
policies, each in a folder of its own, SETTINGS/seed_N. All options of `homeward train` are accepted
and apply to every run. The same command again continues interrupted runs. It prints a table of the
settings and draws their learning curves, sweep.png. `homeward evaluate --agents LABEL:ppo=FOLDER`
takes a folder of seeds.

`homeward sweep --optuna 20 --vary learning_rate=1e-4..1e-2 clip=0.1..0.3 --out runs/search`
searches instead: each trial trains all seeds, in trial_N/seed_M, and its score is that of the best
points of their learning curves. trials.csv holds the table, study.journal the study for
optuna-dashboard.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import itertools
import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich import box
from rich.table import Table

from homeward import cli
from homeward.agents.evaluation.learning_curve import EPISODES, Point, best_so_far, read_curve
from homeward.agents.learning.settings import DivergedError, PPOSettings, TrainingError, check_seed
from homeward.commands import train
from homeward.commands.sweep_plot import sweep_png
from homeward.envs import IDS
from homeward.envs.options import OptionError
from homeward.envs.routes import RouteError
from homeward.files import csv_text, write_whole
from homeward.parallel import ClusterError, TaskError, check_workers, run_tasks
from homeward.physics import RobotError
from homeward.search import SearchError, SearchRange, Trial, import_optuna, search

MARK = "sweep.txt"
"""File that the nodes of a cluster look for in the output folder."""
PLOT = "sweep.png"
"""Learning curves of a sweep, in its folder."""
_ONLY = "as given"  # name of the only settings where nothing varies
TRIALS = "trials.csv"
STUDY = "study.journal"
"""Files of a search in its folder."""
_SHOWN = 10  # number of best trials; chosen: a screen
_BATCHES = ("n_envs", "n_steps", "batch_size")
"""Settings that must divide each other, which few numbers of a range do."""


@dataclass(frozen=True)
class Args:
    """Runs to train, and output."""

    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds."""
    vary: tuple[str, ...] = ()
    """Settings to try, each NAME=VALUE,VALUE: all combinations are trained with every seed. With
    --optuna also ranges, NAME=LOW..HIGH, on a logarithmic scale where HIGH is ten times LOW or
    more."""
    optuna: int | None = None
    """Number of trials of a search instead of all combinations. An interrupted run restarts from
    its beginning, so that the search continues after a kill as an uninterrupted one would."""
    jobs: int = 1
    """Processes on this machine."""
    cluster: str | None = None
    """HOST:PORT of a Ray cluster to train on instead; all its nodes must share the folder --out."""
    train: Annotated[train.Args, tyro.conf.arg(name="")] = field(default_factory=train.Args)


def main(args: Args) -> dict[str, Path]:
    """Train all runs and return their folders by name.

    Raises:
        TrainingError: An argument is invalid.
        TaskError: A run failed; finished ones are kept, and the same command continues.
        SearchError: A range cannot be searched, or Optuna is not installed.
        ClusterError: The cluster cannot be reached.
    """
    if args.optuna is not None:
        return _search(args, args.optuna)
    runs = runs_of(args)
    check_workers(args.jobs, args.cluster)
    write_whole(args.train.out / MARK, "".join(f"{name}\n" for name in runs))
    _say_too_few(runs, set())
    folders = run_tasks(train_quietly, runs, jobs=args.jobs, cluster=args.cluster, title="runs")
    curves = curves_of(folders)
    mission = next(mission for mission, env_id in IDS.items() if env_id == args.train.env)
    write_whole(args.train.out / PLOT, sweep_png(curves, args.train.env, mission))
    cli.Terminal().show(_compared(curves))
    console = cli.Terminal(stderr=True)
    console.print(f"{len(folders)} runs in {args.train.out}, with {PLOT}", soft_wrap=True)
    console.print(
        "these missions chose the kept policies; compare on others by homeward evaluate --agents LABEL:ppo=FOLDER",
        soft_wrap=True,
    )
    return folders


def curves_of(folders: Mapping[str, Path]) -> dict[str, list[list[Point]]]:
    """Learning curve of each seed, by the settings that the name of a run begins with.

    Raises:
        TrainingError: A curve is missing or damaged.
    """
    curves: dict[str, list[list[Point]]] = {}
    for name, folder in folders.items():
        settings, _, _ = name.rpartition("/")
        points = read_curve(folder)
        if not points:
            raise TrainingError(
                f"{folder} has no learning curve any more: delete the folder to train it anew"
            )
        curves.setdefault(settings or _ONLY, []).append(points)
    return curves


def _compared(curves: Mapping[str, list[list[Point]]]) -> Table:
    """One row for each settings: means over seeds, and the range of the kept policies' scores."""
    table = Table(
        title=f"{EPISODES} missions of the learning curves, means over seeds", box=box.SIMPLE_HEAD
    )
    table.add_column("settings", overflow="fold")
    for heading in ("seeds", "kept", "lowest to highest", "stranded", "last"):
        table.add_column(heading, justify="right")
    for settings, seeds in curves.items():
        best_points = [points[best_so_far(points)[-1]] for points in seeds]
        scores = [point.score for point in best_points]
        table.add_row(
            settings,
            str(len(seeds)),
            f"{statistics.fmean(scores):.4g}",
            f"{min(scores):.4g} to {max(scores):.4g}",
            f"{statistics.fmean(point.stranded_rate for point in best_points):.1%}",
            f"{statistics.fmean(points[-1].score for points in seeds):.4g}",
        )
    return table


def _say_too_few(runs: Mapping[str, train.Args], said: set[str]) -> None:
    """Say once of each kind that runs are too short to learn anything."""
    for run in runs.values():
        too_few = run.ppo.too_few(run.steps)
        if too_few is not None and too_few not in said:
            cli.Terminal(stderr=True).print(too_few, soft_wrap=True)
            said.add(too_few)


def runs_of(args: Args) -> dict[str, train.Args]:
    """Runs to train, by the name of their folder.

    Raises:
        TrainingError: A setting does not exist or cannot take a value, or a value or seed is given
            twice.
    """
    base = _base(args)
    runs = dict[str, train.Args]()
    choices = []
    for request in args.vary:
        setting, values = _choices(request)
        if isinstance(values, SearchRange):
            raise TrainingError(
                f"--vary {request}: a range is searched with --optuna N; without it give single values"
            )
        choices.append([(setting, value) for value in values])
    for settings in itertools.product(*choices):
        name = "_".join(f"{key}={value}" for key, value in settings)
        for run, run_args in _seeds_of(base, args.seeds, name, dict(settings)).items():
            if run in runs:
                raise TrainingError(
                    f"--vary {' '.join(args.vary)}: gives {run} twice; give each value once"
                )
            runs[run] = run_args
    return runs


def _base(args: Args) -> train.Args:
    """Options that all runs have in common."""
    if len(set(args.seeds)) < max(len(args.seeds), 1):
        raise TrainingError(
            f"seeds {' '.join(map(str, args.seeds)) or 'none'}: give each seed once, and at least one"
        )
    for seed in args.seeds:
        check_seed(seed)
    base = args.train
    if base.seed:
        raise TrainingError(f"--seed {base.seed} is for a single run: give --seeds {base.seed}")
    if Path(base.robot).is_file():
        base = dataclasses.replace(base, robot=str(Path(base.robot).resolve()))
    if Path(base.route).is_file():
        base = dataclasses.replace(base, route=str(Path(base.route).resolve()))
    return base


def _seeds_of(
    base: train.Args, seeds: tuple[int, ...], name: str, settings: Mapping[str, Any]
) -> dict[str, train.Args]:
    """A run for each seed, by the name of its folder."""
    ppo = dataclasses.replace(base.ppo, **settings)
    runs = {}
    for seed in seeds:
        run = "/".join(part for part in (name, f"seed_{seed}") if part)
        runs[run] = dataclasses.replace(
            base, ppo=ppo, seed=seed, out=base.out.resolve() / run, resume=True
        )
    return runs


def _choices(request: str) -> tuple[str, SearchRange | tuple[Any, ...]]:
    """Name of a setting, and its values or range."""
    name, _, values = request.partition("=")
    defaults = dataclasses.asdict(PPOSettings()) | PPOSettings().by_start
    if name not in defaults:
        raise TrainingError(
            f"--vary {request}: there is no setting {name!r}; choose from {', '.join(defaults)}"
        )
    kind = type(defaults[name])
    low, dots, high = values.partition("..")
    if dots and (kind is str or name in _BATCHES):
        raise SearchError(
            f"--vary {request}: is not searched between ends; give values, as {name}={defaults[name]}"
        )
    texts = values.split(",")
    if dots:
        texts = [low, high]
    try:
        parsed = [kind(text) for text in texts]
    except ValueError:
        raise TrainingError(
            f"--vary {request}: give {kind.__name__} values, as {name}={defaults[name]}"
        ) from None
    if not dots:
        return name, tuple(parsed)
    try:
        return name, SearchRange(*parsed)
    except SearchError as error:
        raise SearchError(f"--vary {request}: {error}") from None


def _search(args: Args, trials: int) -> dict[str, Path]:
    """Train the trials of a search, and print the best."""
    base = dataclasses.replace(_base(args), checkpoints=1)
    space = _space(args, base, trials)
    check_workers(args.jobs, args.cluster)
    import_optuna()
    write_whole(base.out / MARK, f"{trials} trials\n")
    console = cli.Terminal(stderr=True)
    folders = dict[str, Path]()
    said = set[str]()

    def objective(number: int, settings: dict[str, Any]) -> float:
        runs = _seeds_of(base, args.seeds, f"trial_{number}", settings)
        _say_too_few(runs, said)
        scores = run_tasks(
            train_and_score, runs, jobs=args.jobs, cluster=args.cluster, title=f"trial {number}"
        )
        folders.update((name, run_args.out) for name, run_args in runs.items())
        return statistics.fmean(scores.values())

    def keep(done: list[Trial]) -> None:
        _write_trials(base.out / TRIALS, done)
        newest = done[-1]
        console.print(
            f"trial {newest.number}, score {newest.score:.4g}: {_flags(newest)}", soft_wrap=True
        )

    done = search(space, trials, objective, base.out / STUDY, keep)
    ended = [trial for trial in done if not math.isnan(trial.score)]
    ranked = sorted(ended, key=lambda trial: -trial.score)
    if not ranked:
        raise TrainingError(
            "no trial ended with weights that are finite numbers: search smaller learning rates"
        )
    best_trial = ranked[0]
    cli.Terminal().show(_table(ranked[:_SHOWN]))
    console.print(
        f"best: {_flags(best_trial)}, in {args.train.out / f'trial_{best_trial.number}'}",
        soft_wrap=True,
    )
    return folders


def _space(args: Args, base: train.Args, trials: int) -> dict[str, SearchRange | tuple[Any, ...]]:
    """Range or values of each setting, of which every combination can be trained."""
    if trials < 1:
        raise TrainingError(f"optuna = {trials} is not allowed; give at least 1")
    if not args.vary:
        raise TrainingError(
            "--optuna searches what --vary names: give NAME=LOW..HIGH, as learning_rate=1e-4..1e-2"
        )
    space = dict(map(_choices, args.vary))
    if len(space) < len(args.vary):
        raise TrainingError(f"--vary {' '.join(args.vary)}: names a setting twice; give each once")
    # The settings check themselves: what holds at the ends of all ranges holds between them.
    for ends in itertools.product(*map(_ends, space.values())):
        dataclasses.replace(base.ppo, **dict(zip(space, ends, strict=True)))
    return space


def _ends(choice: SearchRange | tuple[Any, ...]) -> tuple[Any, ...]:
    """Both ends of a range, or all values."""
    if isinstance(choice, SearchRange):
        return choice.low, choice.high
    return choice


def _write_trials(file: Path, done: list[Trial]) -> None:
    rows = ([trial.number, trial.score, *trial.settings.values()] for trial in done)
    write_whole(file, csv_text([["trial", "score", *done[0].settings], *rows]))


def _table(ranked: list[Trial]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("trial", "score", *ranked[0].settings):
        table.add_column(heading, justify="right")
    for trial in ranked:
        values = (_short(value) for value in trial.settings.values())
        table.add_row(str(trial.number), f"{trial.score:.4g}", *values)
    return table


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def _flags(trial: Trial) -> str:
    """Settings as options of `homeward train`."""
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in trial.settings.items())


def train_quietly(args: train.Args) -> Path:
    """Train one run without output.

    Raises:
        TrainingError: The run is invalid, or its folder is not visible from here.
    """
    if not any((folder / MARK).is_file() for folder in args.out.parents):
        raise TrainingError(
            f"{args.out} is not visible from this node: give an --out that all nodes share"
        )
    with contextlib.redirect_stderr(io.StringIO()):
        return train.main(args)


def train_and_score(args: train.Args) -> float:
    """Train one run without output; the best score of its learning curve, or NaN if the weights
    diverged.

    Raises:
        TrainingError: As `train_quietly`.
    """
    try:
        folder = train_quietly(args)
    except DivergedError:
        return math.nan
    return max(point.score for point in read_curve(folder) if point.steps)


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    refused = (
        TrainingError,
        SearchError,
        OptionError,
        RobotError,
        RouteError,
        TaskError,
        ClusterError,
    )
    return cli.run(main, Args, __doc__, refused, interrupted="the same command continues")
