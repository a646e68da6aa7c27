"""Train over seeds and settings, several runs at once, on this machine or on a Ray cluster.

`homeward sweep --seeds 0 1 2 --vary learning_rate=1e-3,3e-4 --jobs 2 --out runs/sweep` trains six policies, each in a
folder of its own, SETTINGS/seed_N. All options of `homeward train` can be given, and hold for every run. The same
command again continues what was interrupted. `homeward evaluate --agents ppo=FOLDER` takes a folder of seeds.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from homeward import cli
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.commands import train
from homeward.envs.options import OptionError
from homeward.envs.routes import RouteError
from homeward.files import write_whole
from homeward.parallel import ClusterError, TaskError, check_workers, run_tasks
from homeward.physics import RobotError

MARK = "sweep.txt"
"""File that the nodes of a cluster look for in the output folder."""


@dataclass(frozen=True)
class Args:
    """Which runs to train, and where."""

    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds."""
    vary: tuple[str, ...] = ()
    """Settings to try, each NAME=VALUE,VALUE: all combinations are trained with every seed."""
    jobs: int = 1
    """Runs at once on this machine."""
    cluster: str | None = None
    """HOST:PORT of a Ray cluster to train on instead; --out has to be a folder that all its nodes share."""
    train: Annotated[train.Args, tyro.conf.arg(name="")] = field(default_factory=train.Args)


def main(args: Args) -> dict[str, Path]:
    """Train all runs and return their folders by name.

    Raises:
        TrainingError: An argument cannot be used.
        TaskError: A run failed; those that ended are kept, and the same command continues.
        ClusterError: The cluster cannot be used.
    """
    runs = runs_of(args)
    check_workers(args.jobs, args.cluster)
    write_whole(args.train.out / MARK, "".join(f"{name}\n" for name in runs))
    folders = run_tasks(train_quietly, runs, jobs=args.jobs, cluster=args.cluster, title="runs")
    cli.Terminal(stderr=True).print(f"{len(folders)} runs in {args.train.out}", soft_wrap=True)
    return folders


def runs_of(args: Args) -> dict[str, train.Args]:
    """What to train, by the name of its folder.

    Raises:
        TrainingError: A setting does not exist or cannot take a value, or a value or seed is given twice.
    """
    if len(set(args.seeds)) < max(len(args.seeds), 1):
        raise TrainingError(f"seeds {' '.join(map(str, args.seeds)) or 'none'}: give each seed once, and at least one")
    base = args.train
    if base.seed:
        raise TrainingError(f"--seed {base.seed} is for a single run: give --seeds {base.seed}")
    if Path(base.robot).is_file():
        base = dataclasses.replace(base, robot=str(Path(base.robot).resolve()))
    if Path(base.route).is_file():
        base = dataclasses.replace(base, route=str(Path(base.route).resolve()))
    runs = {}
    for chosen in itertools.product(*(_values(one) for one in args.vary)):
        settings = dataclasses.replace(base.ppo, **dict(chosen))
        for seed in args.seeds:
            name = "/".join([*("_".join(f"{key}={value}" for key, value in chosen).split()), f"seed_{seed}"])
            if name in runs:
                raise TrainingError(f"--vary {' '.join(args.vary)}: gives {name} twice; give each value once")
            out = base.out.resolve() / name
            runs[name] = dataclasses.replace(base, ppo=settings, seed=seed, out=out, resume=True)
    return runs


def _values(given: str) -> list[tuple[str, Any]]:
    """Name and value of a setting, once for each of its values."""
    name, _, values = given.partition("=")
    defaults = dataclasses.asdict(PPOSettings()) | PPOSettings().by_start
    if name not in defaults:
        raise TrainingError(f"--vary {given}: there is no setting {name!r}; choose from {', '.join(defaults)}")
    kind = type(defaults[name])
    try:
        return [(name, kind(value)) for value in values.split(",")]
    except ValueError:
        raise TrainingError(f"--vary {given}: give {kind.__name__} values, as {name}={defaults[name]}") from None


def train_quietly(args: train.Args) -> Path:
    """Train one run without a word.

    Raises:
        TrainingError: The run cannot be made, or its folder is not to be seen from here.
    """
    if not any((folder / MARK).is_file() for folder in args.out.parents):
        raise TrainingError(f"{args.out} is not to be seen from this node: give an --out that all nodes share")
    with contextlib.redirect_stderr(io.StringIO()):
        return train.main(args)


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    refused = (TrainingError, OptionError, RobotError, RouteError, TaskError, ClusterError)
    return cli.run(main, Args, __doc__, refused, interrupted="the same command goes on")
