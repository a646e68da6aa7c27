"""From simulation to a robot that differs from its file: test drives, diagnosis, training and
evaluation.

`python examples/sim_to_real.py --out runs/sim_to_real` simulates a Husky whose turning scrub, rough
ground and computing load the preset `husky` lacks. It records a few test drives of this robot with
noise, and diagnoses them from the preset alone. It then trains policies in simulators only, with
several training seeds, and drives them, beside rules, on that Husky:

* nominal-trained: in the simulator of the preset, with the episode conditions of the site
  (difficulty `uncertain`);
* randomised-trained: the same with more randomisation, to cover what is missing (`harsh`);
* corrected-trained: in the simulator of OUT/diagnosis/corrected.toml, with the conditions of the
  site;
* file-randomised: in the same, with robots and instruments drawn from that file's table
  `[uncertainty]`.

All see the same features and drive the same unseen missions, with the routes, limits and conditions
of the preset's site and the Husky as the true robot. Each policy assumes the robot, instruments and
conditions of its own simulator. If a run is killed, the same command continues it.
"""

from __future__ import annotations

try:
    from homeward.installed import DIAGNOSE, needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[diagnose,train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("diagnose,train", *DIAGNOSE, "matplotlib", "stable_baselines3", "torch")

import dataclasses
import json
import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import tyro
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table
from scipy.ndimage import uniform_filter1d

from homeward import Robot, RobotError, cli, load_robot
from homeward.agents import AgentError, make_policy
from homeward.agents.evaluation import Run, episode_seeds, run_episodes
from homeward.agents.evaluation.summary import Evaluation
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.commands import train
from homeward.diagnosis import Analysis, RecordingError, analyse
from homeward.diagnosis.tell.report import write_outputs
from homeward.envs import IDS
from homeward.envs.options import OptionError, Options
from homeward.envs.vector import HomewardVectorEnv
from homeward.files import write_whole
from homeward.physics import replay

Array = NDArray[np.float64]

MISSION, SITE = "Survey", "uncertain"
NOMINAL = "husky"
MISSING = {
    "turning": {"scrub": 0.6},  # recordings of a Husky on asphalt show 0.59, see docs/results.md
    "surface": {"gain": 1.5},  # rough patches roll up to 2.5 times as hard
    "compute": {"power_w": 60.0, "base_share": 0.5},  # a second computer, for the camera
}
"""What the preset lacks."""

DRIVES, SAMPLES, STEP_S = 4, 3000, 0.1
PATCH_M = 30.0
"""Length of the rough and the smooth stretches of the test ground."""


@dataclass(frozen=True)
class Args:
    """How long to train, on how many missions to drive, and where to write."""

    steps: int = 200_000
    """Decisions that each policy is trained on."""
    episodes: int = 1000
    """Unseen missions on the real robot."""
    seed: int = 0
    """Seed of all that is drawn, and of the first training."""
    trainings: int = 5
    """Training seeds of each policy, one after the other from --seed."""
    out: Path = Path("runs/sim_to_real")
    """Folder for recordings, diagnosis, policies and sim_to_real.json."""
    ppo: Annotated[PPOSettings, tyro.conf.arg(name="")] = field(default_factory=PPOSettings)
    """As in train.py; policies start from the d_max rule."""


@dataclass(frozen=True)
class Contender:
    """A contender: the agent, the robot file that it assumes, and the randomisation of its
    training."""

    agent: str
    believes: str
    difficulty: str = SITE
    randomise: str = "generic"


def real_robot() -> Robot:
    """The robot that truly drives, which neither diagnosis nor training may see."""
    return dataclasses.replace(load_robot(NOMINAL), name="real_husky", effects=MISSING)


def test_drive(robot: Robot, rng: np.random.Generator) -> pd.DataFrame:
    """Five minutes out and back over hilly ground with rough patches, with stops, turns and several
    sensing rates.

    The drive goes through the kernel of the environments. Measured with noise: speed 3 mm/s, yaw
    rate 0.5 mrad/s, grade 2 mrad, power 3 W and 2 %.
    """
    time_s: Array = STEP_S * np.arange(SAMPLES, dtype=np.float64)
    speed = _smooth(robot.max_speed_mps * _levels(rng, (0.0, 0.4, 0.7, 1.0), 10.0, 25.0), 1.5)
    moving = speed > 0.02
    speed = speed * moving
    yaw_rate = _smooth(_levels(rng, (0.0, 0.0, 0.4, -0.4, 0.8, -0.8), 4.0, 10.0), 0.9) * moving
    sensing_hz = robot.max_sensing_hz * _levels(rng, (0.0, 0.25, 0.5, 1.0), 15.0, 40.0)
    way_m = np.cumsum(speed) * STEP_S
    outward = np.where(way_m < 0.5 * way_m[-1], 1.0, -1.0)
    from_base_m = np.minimum(way_m, way_m[-1] - way_m)
    grade = outward * 0.05 * np.sin(2.0 * np.pi * from_base_m / 45.0)
    power_w = replay(
        robot, time_s, speed, grade_rad=grade, yaw_rate_radps=yaw_rate, sensing_hz=sensing_hz,
        roughness=np.mod(from_base_m, 2.0 * PATCH_M) > PATCH_M, base_distance_m=from_base_m, direction=outward,
    ).power_w  # fmt: skip

    def noise(deviation: float) -> Array:
        return deviation * rng.standard_normal(SAMPLES)

    columns = {
        "time_s": time_s,
        "speed_mps": speed + noise(0.003) * moving,
        "yaw_rate_radps": yaw_rate + noise(0.0005),
        "grade_rad": grade + noise(0.002),
        "distance_m": way_m,
        "base_distance_m": from_base_m,
        "sensing_hz": sensing_hz,
        "power_w": power_w * (1.0 + noise(0.02)) + noise(3.0),
    }
    return pd.DataFrame(columns).round(5)


def _levels(
    rng: np.random.Generator, choices: tuple[float, ...], shortest_s: float, longest_s: float
) -> Array:
    """Levels held for random times, shape (SAMPLES,)."""
    lengths = (rng.uniform(shortest_s, longest_s, SAMPLES) / STEP_S).astype(int)
    return np.repeat(rng.choice(choices, SAMPLES), lengths)[:SAMPLES]


def _smooth(values: Array, over_s: float) -> Array:
    smoothed: Array = uniform_filter1d(values, round(over_s / STEP_S), mode="nearest")
    return smoothed


def diagnosed(args: Args) -> Analysis:
    """Record the test drives and diagnose them with the preset; both are written."""
    paths = []
    for number in range(DRIVES):
        paths.append(args.out / "recordings" / f"drive_{number}.csv")
        recording = test_drive(real_robot(), np.random.default_rng([args.seed, number]))
        write_whole(paths[-1], recording.to_csv(index=False))
    analysis = analyse(paths, NOMINAL, None, args.seed)
    write_outputs(analysis, args.out / "diagnosis")
    return analysis


def contenders(args: Args) -> dict[str, Contender]:
    """Policies and, for reference, rules: one that trusts its map and one that corrects it by what
    it measures."""
    corrected = str(args.out / "diagnosis" / "corrected.toml")
    return {
        "nominal-trained": Contender("ppo", NOMINAL),
        "randomised-trained": Contender("ppo", NOMINAL, "harsh"),
        "corrected-trained": Contender("ppo", corrected),
        "file-randomised": Contender("ppo", corrected, randomise="file"),
        **{
            f"{rule}, {name}": Contender(rule, file)
            for rule in ("dmax_mapped", "dmax_adaptive")
            for name, file in (("nominal", NOMINAL), ("corrected", corrected))
        },
    }


def simulator(contender: Contender) -> Options:
    """The environment that a contender knows: its robot file at the site of the preset."""
    return Options(
        MISSION,
        robot=contender.believes,
        difficulty=contender.difficulty,
        randomise=contender.randomise,
        scaled_for=NOMINAL,
    )


def reality(contender: Contender, real: Path) -> Options:
    """The environment of the evaluation: the same site and conditions, and the real robot."""
    return dataclasses.replace(
        simulator(contender), difficulty=SITE, randomise="generic", true_robot=str(real)
    )


def folder(args: Args, label: str, number: int) -> Path:
    """Where a policy lies."""
    return args.out / label / str(args.seed + number)


def learn(args: Args, label: str, contender: Contender, number: int) -> None:
    """Train a policy in its simulator with `train.py`, or find it trained."""
    settings = train.Args(
        env=IDS[MISSION], out=folder(args, label, number), steps=args.steps, seed=args.seed + number, resume=True,
        replace=True, curve=4, difficulty=contender.difficulty, robot=contender.believes, randomise=contender.randomise,
        scaled_for=NOMINAL, ppo=args.ppo,
    )  # fmt: skip
    train.main(settings)


def drive(
    args: Args, label: str, contender: Contender, options: Options, seeds: list[int]
) -> list[Run]:
    """Drive unseen missions, once for each training seed."""
    # with the robot that it assumes; the options say what it meets
    env = HomewardVectorEnv(**vars(simulator(contender)))
    files = (
        [folder(args, label, number) for number in range(args.trainings)]
        if contender.agent == "ppo"
        else [None]
    )
    return [run_episodes(make_policy(contender.agent, env, file), options, seeds) for file in files]


def main(args: Args) -> dict[str, Any]:
    """Run it all, print what was found and the table, and return what sim_to_real.json holds.

    Raises:
        TrainingError, OptionError, RobotError, RecordingError, AgentError: An argument cannot be
            used.
        OSError: The output folder cannot be written to.
    """
    if args.episodes < 2 or args.seed < 0 or args.trainings < 1:
        raise OptionError(
            f"--episodes {args.episodes} --seed {args.seed} --trainings {args.trainings}: give at least 2 episodes, a "
            "seed of 0 or more and at least 1 training"
        )
    real, all_of_them = args.out / "real.toml", contenders(args)
    analysis = diagnosed(args)
    write_whole(real, real_robot().to_toml())
    for label, contender in all_of_them.items():
        if contender.agent == "ppo":
            for number in range(args.trainings):
                learn(args, label, contender, number)
    seeds = episode_seeds(args.seed, args.episodes)
    runs, promised = {}, {}
    for label, contender in all_of_them.items():
        runs[label] = drive(args, label, contender, reality(contender, real), seeds)
        promised[label] = drive(args, label, contender, simulator(contender), seeds)
    first, rng = next(iter(all_of_them.values())), np.random.default_rng(args.seed)
    result = {
        "command": shlex.join(sys.argv),
        "steps": args.steps,
        "training_seeds": [args.seed + number for number in range(args.trainings)],
        "missing": MISSING,
        "found": {effect.effect: {name: value.value for name, value in effect.parameters.items()}
                  for effect in analysis.diagnosis.missing_physics},
        "contenders": {label: dataclasses.asdict(contender) for label, contender in all_of_them.items()},
        "real": Evaluation(IDS[MISSION], reality(first, real), args.seed, seeds, runs).summary(rng),
        "simulated": Evaluation(IDS[MISSION], simulator(first), args.seed, seeds, promised).summary(rng),
    }  # fmt: skip
    write_whole(args.out / "sim_to_real.json", json.dumps(result, indent=2, allow_nan=False) + "\n")
    show(result, analysis, args)
    return result


def show(result: dict[str, Any], analysis: Analysis, args: Args) -> None:
    """Print what the diagnosis found beside what is missing, and who came home with what."""
    console = Console()
    console.width = max(console.width, 100)  # what the table needs
    console.print(analysis.diagnosis.summary, markup=False, highlight=False)
    for effect, true in MISSING.items():
        found = {**analysis.corrected.effects}.get(effect)
        numbers = (
            "not found"
            if found is None
            else ", ".join(f"{name} {value:.3g}" for name, value in found.items())
        )
        truth = ", ".join(f"{name} {value:g}" for name, value in true.items())
        console.print(f"{effect}: {numbers}; in truth {truth}", highlight=False)
    real, simulated = result["real"], result["simulated"]
    table = Table(
        title=f"{real['env']} on the real robot, {real['options']['difficulty']}, {real['episodes']} unseen missions, "
        f"seed {real['seed']}; training seeds: {args.trainings}, of {args.steps:,} decisions, from {args.ppo.start}",
        caption="below: 95 % intervals, of scores by bootstrap over missions and seeds, of stranding by Wilson\n"
        "simulated: the same seeds in its own simulator, score and share that strands\n"
        + ", ".join(f"{library} {which}" for library, which in real["versions"].items()),
        box=box.SIMPLE_HEAD,
    )
    table.add_column("driven by", min_width=18)
    for heading in ("score", "minus nominal", "minus corrected", "stranded", "late", "simulated"):
        table.add_column(heading, justify="right", no_wrap=True)
    for label, result in real["agents"].items():
        against = [
            real["paired"].get(f"{label} - {other}")
            for other in ("nominal-trained", "corrected-trained")
        ]
        alone = simulated["agents"][label]
        table.add_row(
            label,
            _interval(result["score_mean"], result["score_ci95"], ".0f"),
            *(
                "" if other is None else _interval(other["mean"], other["ci95"], "+.0f")
                for other in against
            ),
            _interval(result["stranded_rate"], result["stranded_ci95"], ".1%"),
            str(result["timed_out"]),
            f"{alone['score_mean']:.0f}\n{alone['stranded_rate']:.1%}",
        )
    console.print(table)
    console.print(
        f"Written to {args.out}: recordings, diagnosis, policies, sim_to_real.json", highlight=False
    )


def _interval(value: float, ends: list[float], form: str) -> str:
    return f"{value:{form}}\n[dim]{ends[0]:{form}} {ends[1]:{form}}[/dim]"


if __name__ == "__main__":
    refused = (TrainingError, OptionError, RobotError, RecordingError, AgentError)
    sys.exit(cli.run(main, Args, __doc__, refused, interrupted="the same command goes on"))
