"""Missions that turn when the companion says so: how many strand, and how far they get beside those of the shield.

`python benchmarks/on_the_robot/companion.py` drives missions of OutAndBack out at cruise, feeds a companion each with
what the environment's instruments read, and turns where it says `turn_now`; the shield guards the same missions of a
policy that never turns. It prints what docs/on_the_robot.md quotes; OUT/companion.json holds it. Finished parts are
kept, so that a run that was killed goes on.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numba
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.kept import Kept
from benchmarks.tables import rate, span, table
from homeward import cli
from homeward.agents import Policy
from homeward.agents.base import Observations, feature
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward
from homeward.companion import Companion
from homeward.envs.actions import encode_actions
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.state import GO, RETURN
from homeward.parallel import ClusterError, run_tasks

PART = 500
"""Missions of a part, side by side."""
RISK = 1e-3
"""Of not getting home, which the companion is told to accept."""


@dataclass(frozen=True)
class Args:
    """What to drive."""

    missions: int = 20_000
    """Missions."""
    difficulty: str = "uncertain"
    """Difficulty."""
    seed: int = 0
    """Seed that the missions follow from, as in evaluate.py."""
    jobs: int = 1
    """Processes at once."""
    out: Path = Path("runs/companion")
    """Folder of the results."""


@final
class Advised(Policy):
    """Drives on at cruise, and home as soon as its companion says so; now and then it looks back, as it is advised to.

    The companion gets readings in SI units, and knows nothing of the environment: its robot's file, and no forecast.

    Args:
        known: Constants of the environment.

    Attributes:
        update_s: Time that the updates took, one a decision and mission.
    """

    def __init__(self, known: Known) -> None:
        self._known = known
        cruise = known.shared["cruise_mps"][0]
        self._on, self._home = (encode_actions(known, cruise, 0.0, mode)[0] for mode in (GO, RETURN))
        self._back = encode_actions(known, known.shared["min_speed_mps"][0], 0.0, RETURN)[0]
        self._companions: list[Companion] = []
        self.update_s: list[float] = []

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        if begun.all():  # all missions of a batch begin together
            self._companions = [self._new() for _ in begun]
        readings = self._readings(observations)
        actions = np.repeat(self._on[None], len(begun), axis=0)
        for k, companion in enumerate(self._companions):
            start = time.perf_counter()
            advice = companion.update(**{name: float(values[k]) for name, values in readings.items()})
            self.update_s.append(time.perf_counter() - start)
            if advice.turn_now:
                actions[k] = self._home
            elif advice.looks_back:
                actions[k] = self._back
        return actions

    def _new(self) -> Companion:
        return Companion(self._known.robot, risk=RISK, window_s=float(self._known.shared["decision_s"][0]))

    def _readings(self, observations: Observations) -> dict[str, NDArray[np.float64]]:
        s = self._known.shared[0]
        return {
            "time_s": np.rint(feature(observations, "time") * s["max_decisions"]) * s["decision_s"],
            "speed_mps": feature(observations, "speed") * s["max_speed_mps"],
            "power_w": feature(observations, "power") * s["cruise_w"],
            "soc": feature(observations, "energy"),
            "grade_rad": np.arcsin(0.1 * feature(observations, "grade")),
            "heading_rad": np.arctan2(feature(observations, "north"), feature(observations, "east")),
            "position": feature(observations, "distance") * s["reach_m"],
        }


Task = tuple[Options, list[int]]
"""Environment, and the seeds of missions."""


def part_of(task: Task) -> dict[str, Any]:
    """Strandings, scores and update times of some missions."""
    options, seeds = task
    numba.set_num_threads(1)
    known = known_of(options)
    advised = Advised(known)
    own = run_episodes(advised, options, seeds).episodes
    shield = run_episodes(Shield(Onward(known), known), options, seeds).episodes
    return {
        "stranded": int(own.stranded.sum()), "score": own.score.tolist(),
        "shield_stranded": int(shield.stranded.sum()), "shield_score": shield.score.tolist(),
        "update_us": np.quantile(1e6 * np.array(advised.update_s), (0.5, 0.99)).tolist(),
    }  # fmt: skip


def main(args: Args) -> None:
    """Drive the parts that are missing, keep each, and print.

    Raises:
        OptionError, ClusterError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.missions < 2 or args.seed < 0 or args.difficulty not in DIFFICULTIES:
        raise OptionError(
            f"give at least 2 --missions, a --seed of 0 or more and --difficulty {', '.join(DIFFICULTIES)}"
        )
    options, seeds = Options("OutAndBack", difficulty=args.difficulty), episode_seeds(args.seed, args.missions)
    tasks: dict[str, Task] = {
        str(first): (options, seeds[first : first + PART]) for first in range(0, len(seeds), PART)
    }
    kept = Kept(args.out / "companion.json", missions=args.missions, difficulty=args.difficulty, seed=args.seed)
    run_tasks(part_of, kept.missing(tasks), jobs=args.jobs, keep=kept.keep, title="parts")
    Console(width=110).print(table_of(args, [kept.results[key] for key in tasks]))


def table_of(args: Args, parts: list[dict[str, Any]]) -> Table:
    """What the missions came to, for the companion and the shield."""
    scores = {name: np.concatenate([part[name] for part in parts])[None] for name in ("score", "shield_score")}
    mean, of_shield = (float(one.mean()) for one in scores.values())
    means = Bootstrap(scores, args.seed).means()
    ratio = span(mean / of_shield, interval(means["score"] / means["shield_score"]), ".1%")
    title = f"{args.missions} missions of OutAndBack, {args.difficulty}, seed {args.seed}; risk {RISK:g}"
    right = ("stranded (95 %)", "mean score, m", "of the shield's (95 %)", "update, median, 99 %")
    shown = table(title, ("turns by",), right)
    times = (f"{math.fsum(part['update_us'][k] for part in parts) / len(parts):.0f} us" for k in (0, 1))
    rows = ("companion", "stranded", mean, ratio, ", ".join(times)), ("shield", "shield_stranded", of_shield, "", "")
    for name, stranded, score, *rest in rows:
        count = sum(part[stranded] for part in parts)
        shown.add_row(name, f"{count}, {rate(count, args.missions, '.3%')}", f"{score:.1f}", *rest)
    return shown


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, ClusterError)))
