"""Missions that turn when the companion says so: how many strand, and how far they get beside those of the shield.

`python benchmarks/on_the_robot/companion.py` drives missions of OutAndBack out at cruise, feeds a companion each with
what the environment's instruments read, and turns where it says `turn_now`; the shield guards the same missions of a
policy that never turns. It prints what docs/on_the_robot.md quotes; OUT/companion.json holds it. Finished parts are
kept, so that a run that was killed goes on.
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numba
import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from homeward import cli
from homeward.agents import Policy
from homeward.agents.base import Observations, feature
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.statistics import Bootstrap, interval, wilson
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward
from homeward.companion import Companion
from homeward.envs.actions import encode_actions
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.state import GO, RETURN
from homeward.files import write_whole
from homeward.parallel import ClusterError, run_tasks

PART = 500
"""Missions of a part, side by side."""


@dataclass(frozen=True)
class Args:
    """What to drive."""

    missions: int = 20_000
    """Missions."""
    difficulty: str = "uncertain"
    """Difficulty."""
    route: str = "generated"
    """generated or hidden_wind."""
    robot: str = "rusti_computer"
    """Robot."""
    risk: float = 1e-3
    """Risk of not getting home that the companion is told to accept."""
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
        risk: Of not getting home that is accepted.

    Attributes:
        update_s: Time that the updates took, one a decision and mission.
    """

    def __init__(self, known: Known, risk: float) -> None:
        self._known, self._risk = known, risk
        cruise = known.shared["cruise_mps"][0]
        self._on, self._home = (encode_actions(known, cruise, 0.0, mode)[0] for mode in (GO, RETURN))
        self._back = encode_actions(known, known.shared["min_speed_mps"][0], 0.0, RETURN)[0]
        self._companions: list[Companion] = []
        self.update_s: list[float] = []

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        if len(begun) != len(self._companions):
            self._companions = [self._new() for _ in begun]
        else:
            for k in np.flatnonzero(begun).tolist():
                self._companions[k] = self._new()
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
        return Companion(self._known.robot, risk=self._risk, window_s=float(self._known.shared["decision_s"][0]))

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


Task = tuple[Options, float, tuple[int, ...]]
"""Environment, risk, and the seeds of missions."""


def part_of(task: Task) -> dict[str, Any]:
    """Strandings, scores and update times of some missions."""
    options, risk, seeds = task
    numba.set_num_threads(1)
    known = known_of(options)
    advised = Advised(known, risk)
    own = run_episodes(advised, options, list(seeds)).episodes
    shield = run_episodes(Shield(Onward(known), known), options, list(seeds)).episodes
    return {
        "stranded": np.flatnonzero(own.stranded).tolist(), "timed_out": int(own.timed_out.sum()),
        "score": own.score.tolist(), "shield_stranded": int(shield.stranded.sum()),
        "shield_score": shield.score.tolist(),
        "update_us": np.quantile(1e6 * np.array(advised.update_s), (0.5, 0.99)).tolist(),
    }  # fmt: skip


def main(args: Args) -> None:
    """Drive the parts that are missing, keep each, and print.

    Raises:
        OptionError, ClusterError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.missions < 2 or args.seed < 0 or args.difficulty not in DIFFICULTIES or not 1e-6 <= args.risk <= 0.5:
        raise OptionError("give at least 2 --missions, a --seed of 0 or more, a --difficulty and a --risk up to 0.5")
    options = Options("OutAndBack", difficulty=args.difficulty, route=args.route, robot=args.robot)
    seeds = episode_seeds(args.seed, args.missions)
    tasks: dict[str, Task] = {
        str(first): (options, args.risk, tuple(seeds[first : first + PART])) for first in range(0, len(seeds), PART)
    }
    common = {**{k: v for k, v in vars(args).items() if k not in ("out", "jobs", "missions")}, "part": PART}
    file, kept = args.out / "companion.json", dict[str, Any]()
    if file.is_file():
        content = json.loads(file.read_text())
        kept = content["parts"] if {name: content.get(name) for name in common} == common else {}
    console = Console(width=110)

    def keep(key: str, part: dict[str, Any]) -> None:
        kept[key] = part
        write_whole(file, json.dumps({**common, "parts": kept}) + "\n")
        console.print(f"missions from {key}: {len(part['stranded'])} stranded", style="dim", highlight=False)

    missing = {key: task for key, task in tasks.items() if len(kept.get(key, {}).get("score", ())) != len(task[2])}
    run_tasks(part_of, missing, jobs=args.jobs, keep=keep, title="parts")
    console.print(table_of(args, [kept[key] for key in tasks]))


def table_of(args: Args, parts: list[dict[str, Any]]) -> Table:
    """What the missions came to, for the companion and the shield."""
    scores = {name: np.concatenate([part[name] for part in parts])[None] for name in ("score", "shield_score")}
    count = scores["score"].size
    means = Bootstrap(scores, args.seed).means()
    low, high = interval(means["score"] / means["shield_score"])
    setting = f"{args.difficulty}, {args.route}, {args.robot}, seed {args.seed}"
    table = Table(title=f"{count} missions of OutAndBack, {setting}; risk {args.risk:g}", box=box.SIMPLE_HEAD)
    for heading in ("turns by", "stranded (95 %)", "mean score, m", "of the shield's (95 %)", "update, median, 99 %"):
        table.add_column(heading, justify="left" if heading == "turns by" else "right")
    for name, stranded, score, ratio, times in (
        ("companion", sum(len(part["stranded"]) for part in parts), "score",
         f"{float(scores['score'].mean() / scores['shield_score'].mean()):.1%} ({low:.1%} to {high:.1%})",
         ", ".join(f"{math.fsum(part['update_us'][k] for part in parts) / len(parts):.0f} us" for k in (0, 1))),
        ("shield", sum(part["shield_stranded"] for part in parts), "shield_score", "", ""),
    ):  # fmt: skip
        least, most = wilson(stranded, count)
        rate = f"{stranded}, {stranded / count:.3%} ({least:.3%} to {most:.3%})"
        table.add_row(name, rate, f"{float(scores[score].mean()):.1f}", ratio, times)
    return table


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, ClusterError)))
