"""Train a policy with PPO.

`homeward train --env homeward/Survey-v0 --out DIR`, in a checkout also `python train.py`, writes
DIR/policy.safetensors and DIR/policy.json, for `homeward evaluate --agents ppo=DIR`. It also writes
checkpoints, for --resume, DIR/curve.csv and DIR/tensorboard.
"""

from __future__ import annotations

import dataclasses
import math
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import homeward  # noqa: F401 - first: it says in a line what is not installed

# isort: split
import tyro

from homeward import cli
from homeward.agents.learning.settings import PPOSettings, TrainingError, check_seed
from homeward.agents.trained.provenance import made_with
from homeward.agents.trained.run_folder import RunState, extended_from, locked, open_run
from homeward.envs import IDS
from homeward.envs.docks import text_of
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.routes import RouteError
from homeward.installed import advice
from homeward.physics import RobotError


@dataclass(frozen=True)
class Args:
    """Training and output."""

    env: str = "homeward/Survey-v0"
    """Environment id."""
    out: Path = Path("runs/ppo")
    """Folder of the run."""
    steps: int = 3_000_000
    """Decisions to train on, rounded up to whole updates."""
    seed: int = 0
    """Seed of all random numbers."""
    resume: bool = False
    """Continue the run of this folder from its last checkpoint, if it has one; with more steps also
    a finished one."""
    replace: bool = False
    """If the folder contains a run with other settings or of other code, remove it and train anew,
    unless it is longer and finished."""
    checkpoints: int = 4
    """Equal parts of the run, after each of which a checkpoint is written: a kill loses at most one
    part. Missions restart there, so that a resumed run ends like an uninterrupted one."""
    curve: int = 10
    """Points of the learning curve, curve.csv: each of the same 500 missions, driven by the present
    policy."""
    wandb: str | None = None
    """Project of Weights & Biases for figures and curve, besides TensorBoard; WANDB_MODE=offline
    keeps them in the folder of the run."""
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
    shaping: str = "dmax"
    """dmax or none."""
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
    scaled_for: str | None = None
    """Preset name or TOML file of the robot for which routes and limits are scaled, if not
    --robot."""
    ppo: Annotated[PPOSettings, tyro.conf.arg(name="")] = field(default_factory=PPOSettings)


def main(args: Args) -> Path:
    """Train, unless the run is finished, and return the folder with the policy.

    Raises:
        TrainingError, OptionError, RobotError, RouteError: An argument is invalid.
        OSError: The output folder cannot be written to.
    """
    options = _options(args)
    known = known_of(options)  # invalid robots and routes are found before anything is written
    settings = {
        "env": args.env,
        **{name: value for name, value in vars(options).items() if name != "mission"},
        "docks": text_of(options.docks),
        "steps": args.steps,
        "seed": args.seed,
        "checkpoints": args.checkpoints,
        **dataclasses.asdict(args.ppo),
        **args.ppo.by_start,
    }
    with locked(args.out):
        return _train(args, options, known, settings)


def _train(args: Args, options: Options, known: Known, settings: Mapping[str, Any]) -> Path:
    code = made_with(options)
    try:  # before an older run may be removed
        from homeward.agents.learning.ppo import train
    except ModuleNotFoundError as error:
        raise TrainingError(
            f"training needs {error.name}: {advice('train', str(error.name))}"
        ) from None
    if args.wandb is not None and find_spec("wandb") is None:
        raise TrainingError(f"--wandb needs wandb: {advice('wandb', 'wandb')}")
    state = open_run(args.out, settings, code, resume=args.resume, replace=args.replace)
    console = cli.Terminal(stderr=True)
    if state is RunState.FINISHED:
        console.print(
            f"{args.out} contains this run, finished: nothing to do; another --seed or --out trains anew",
            soft_wrap=True,
        )
        return args.out
    if state is RunState.REPLACED:
        console.print(
            f"{args.out} contained a run with other settings or of other code: removed, training anew",
            markup=False,
            soft_wrap=True,
        )
    too_few = args.ppo.too_few(args.steps)
    if too_few is not None:
        console.print(too_few, markup=False, highlight=False, soft_wrap=True)
    trained = train(
        options,
        args.ppo,
        args.steps,
        args.seed,
        args.out,
        details={
            "env": args.env,
            "decision_s": float(known.shared["decision_s"][0]),
            "training": settings,
            "extended_from": extended_from(args.out),
            "made_with": code,
            "command": shlex.join(sys.argv),
        },
        checkpoints=args.checkpoints,
        curve=args.curve,
        restore=state is RunState.CONTINUED,
        console=console,
        wandb=args.wandb,
    )
    exploring = ""
    if not math.isnan(trained.score):  # of a run in which no mission ended
        exploring = f"; the last missions, still exploring: {trained.home_rate:.1%} home, score {trained.score:.4g}"
    console.print(
        f"{trained.steps:,} steps{exploring}. Written to {args.out}: policy.safetensors, policy.json",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    return args.out


def _options(args: Args) -> Options:
    missions = {env_id: mission for mission, env_id in IDS.items()}
    if args.env not in missions:
        raise OptionError(f"unknown env {args.env!r}; choose from {', '.join(missions)}")
    if args.action_type == "flat":
        raise TrainingError(
            "action_type = 'flat' is for learners of one list of actions; train with 'discrete'"
        )
    check_seed(args.seed)
    for name, value, lowest in (
        ("steps", args.steps, 1),
        ("checkpoints", args.checkpoints, 1),
        ("curve", args.curve, 1),
    ):
        if not value >= lowest:
            raise TrainingError(f"{name} = {value} is not allowed; give at least {lowest}")
    return Options(
        missions[args.env],
        robot=args.robot,
        route=args.route,
        difficulty=args.difficulty,
        instruments=args.instruments,
        weather=args.weather,
        action_type=args.action_type,
        shaping=args.shaping,
        discount=args.ppo.discount,
        decision_s=args.decision_s,
        randomise=args.randomise,
        docks=args.docks,
        time_limit_s=args.time_limit,
        scaled_for=args.scaled_for,
    )


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    refused = (TrainingError, OptionError, RobotError, RouteError)
    return cli.run(main, Args, __doc__, refused, interrupted="continue with --resume")


if __name__ == "__main__":
    sys.exit(run())
