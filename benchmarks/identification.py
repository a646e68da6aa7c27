"""How well a robot finds out what it is today, and what its way home takes: the table of docs/identification.md.

`python benchmarks/identification.py` drives missions out for some decisions, asks everyone what the way home takes, and
drives home to see what it took. Then it lets the planner drive by worse gauges. It takes about two minutes.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

from homeward import cli
from homeward.agents.base import Observations, Policy, feature
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.identification import Identification
from homeward.agents.registry import AGENTS, Request
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.pace import NO_SENSING
from homeward.envs.actions import LEVELS
from homeward.envs.features import INDEX
from homeward.envs.options import OptionError, Options, known_of
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv

Array = NDArray[np.float64]
GAUGES = {
    "exact": (0.0, 0.0),
    "steps of 0.1 %": (1e-3, 0.0),
    "noise of 0.1 %": (0.0, 1e-3),
    "steps of 1 %": (1e-2, 0.0),
}
"""Step and standard deviation of the noise of gauges, as shares of the battery."""
AGENTS_COMPARED = ("dmax_adaptive", "planner")


@dataclass(frozen=True)
class Args:
    """What to drive."""

    difficulties: tuple[str, ...] = ("known", "uncertain", "harsh")
    """Difficulties."""
    decisions: tuple[int, ...] = (15, 30, 45)
    """Decisions of the way out."""
    missions: int = 1000
    """Missions of each."""
    seed: int = 0
    """Seed that the missions follow from, as in evaluate.py."""


@dataclass(frozen=True)
class Errors:
    """Errors of those missions that came home, each of shape (missions,): of the way home as shares of what it took.

    Attributes:
        by_whom: Errors of the way home, by name.
        rolling: Of the rolling resistance by the gauge, as a share.
        wind_mps: Of the wind.
        home: Share of the missions that came home.
    """

    by_whom: dict[str, Array]
    rolling: Array
    wind_mps: Array
    home: float


def main(args: Args) -> None:
    """Drive and print.

    Raises:
        OptionError: An argument cannot be used.
    """
    if args.missions < 2 or args.seed < 0 or any(count < 1 for count in args.decisions):
        raise OptionError("give at least 2 --missions, a --seed of 0 or more and --decisions of 1 or more")
    table = Table(title=f"Error of the way home, {args.missions} missions, seed {args.seed}", box=box.SIMPLE_HEAD)
    for heading in (
        "difficulty", "decisions out", "by the file", "dmax_adaptive", "identified", "one speed", "rolling",
        "wind, m/s", "home",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if heading == "difficulty" else "right")
    for difficulty in args.difficulties:
        for count in args.decisions:
            probing, steady = (drive(args, difficulty, count, probes) for probes in (True, False))
            whom = [*probing.by_whom.values(), steady.by_whom["identified"]]
            table.add_row(
                difficulty, str(count), *(f"{median(one):.2%}, {worst(one):.1%}" for one in whom),
                f"{median(probing.rolling):.2%}, {worst(probing.rolling):.1%}",
                f"{median(probing.wind_mps):.2f}, {worst(probing.wind_mps):.1f}", f"{probing.home:.1%}",
            )  # fmt: skip
    console = Console(width=140)
    console.print(table)
    console.print(
        "Median and 95th percentile of the absolute error. `one speed`: identified without the changes of speed.",
        highlight=False,
    )
    console.print(gauges(args))


def gauges(args: Args) -> Table:
    """Scores and strandings with an exact gauge and with worse ones."""
    options = Options("OutAndBack")
    known, seeds = known_of(options), episode_seeds(args.seed, args.missions)
    table = Table(
        title=f"OutAndBack, uncertain, by the gauge: score and stranded, {args.missions} missions", box=box.SIMPLE_HEAD
    )
    for heading in ("gauge", *AGENTS_COMPARED):
        table.add_column(heading, justify="left" if heading == "gauge" else "right")
    for name, (step, noise) in GAUGES.items():
        row = [name]
        for agent in AGENTS_COMPARED:
            policy = AGENTS[agent](Request(known, None, 0))
            episodes = run_episodes(WorseGauge(policy, step, noise, args.seed), options, seeds).episodes
            row.append(f"{episodes.score.mean():.4g}, {episodes.stranded.mean():.1%}")
        table.add_row(*row)
    return table


class WorseGauge(Policy):
    """Shows a policy the energy left in steps and with noise, as shares of the battery."""

    def __init__(self, policy: Policy, step: float, noise: float, seed: int) -> None:
        self._policy, self._step, self._noise = policy, step, noise
        self._rng = np.random.default_rng(seed)

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        shown, energy = observations.copy(), feature(observations, "energy")
        if self._noise:
            energy += self._rng.normal(0.0, self._noise, len(energy))
        shown[:, INDEX["energy"]] = np.round(energy / self._step) * self._step if self._step else energy
        return self._policy.act(shown, begun)


def median(errors: Array) -> float:
    """Median of absolute errors."""
    return float(np.median(np.abs(errors)))


def worst(errors: Array) -> float:
    """95th percentile of absolute errors."""
    return float(np.quantile(np.abs(errors), 0.95))


def drive(args: Args, difficulty: str, count: int, probes: bool) -> Errors:
    """Drive out for some decisions, and home."""
    options = Options("OutAndBack", difficulty=difficulty)
    env = HomewardVectorEnv(args.missions, autoreset_mode="Disabled", **vars(options))
    observations, info = env.reset(seed=episode_seeds(args.seed, args.missions))
    identification = Identification(env.batch.known)
    adaptive = AdaptiveDmaxRule(env.batch.known, NO_SENSING, 0.0)
    begun, nobody = np.ones(args.missions, np.bool_), np.zeros(args.missions, np.bool_)
    for decision in range(count + 1):
        identification.learn(observations, begun)
        believed = adaptive.look(observations, begun)
        begun = nobody
        if decision < count:
            speed = np.where(identification.probes & probes, (LEVELS - 1) // 2, LEVELS - 1)
            observations, *_ = env.step(_actions(speed, GO))
    energy, home_cost = feature(observations, "energy"), feature(observations, "home_cost")
    found = identification.look_home(observations, 0.0)[:, 0]
    off = identification.unknown - truth(env)
    used, home, over = np.full(args.missions, np.nan), nobody.copy(), nobody.copy()
    while not over.all():
        observations, _, terminated, truncated, info = env.step(_actions(np.full(args.missions, LEVELS - 1), RETURN))
        new = (terminated | truncated) & ~over
        used[new], home[new] = (energy - feature(observations, "energy"))[new], info["home"][new]
        over |= new
        if (terminated | truncated).any():
            env.reset(options={"reset_mask": terminated | truncated})  # they go on, and nobody looks
    took = used[home]
    by_whom = {"by the file": home_cost, "dmax_adaptive": believed.home, "identified": found}
    return Errors(
        {name: one[home] / took - 1.0 for name, one in by_whom.items()},
        off[home, 1],
        np.hypot(off[home, 3], off[home, 4]),
        float(home.mean()),
    )


def truth(env: HomewardVectorEnv) -> Array:
    """The numbers of `identification_kernel.UNKNOWN` as they are, shape (missions, 5)."""
    m, p, nominal = env.batch.records, env.batch.robots, env.batch.known.robot.record()[0]
    gauge = env.batch.known.shared["usable_j"][0] / m["capacity_j"] * (1.0 + m["gauge_bias"])
    weight = gauge * (p["mass_kg"] + p["payload_mass_kg"]) / (nominal["mass_kg"] + nominal["payload_mass_kg"])
    rolling = weight * p["rolling_resistance"] / nominal["rolling_resistance"]
    wind_mps = np.where(env.batch.known.shared["difficulty"][0] > 0, m["wind_mps"], 0.0)
    wind = wind_mps * np.stack((np.cos(m["wind_from_rad"]), np.sin(m["wind_from_rad"])))
    return np.stack((gauge, rolling, weight, *wind), axis=1)


def _actions(speed: NDArray[Any], mode: int) -> NDArray[np.int64]:
    return np.stack((speed, np.zeros(len(speed), np.int64), np.full(len(speed), mode)), axis=1)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError,)))
