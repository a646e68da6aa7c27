"""Tune rules, planner and shield, each with as many trials: the numbers of `reserves.py` and of the shield.

`python benchmarks/agents/tune.py` prints the tables and the numbers. Missions have seeds of their own, which neither
training nor evaluation meets; the robot is the default one, and who strands scores 0.

* A rule has the reserve with the highest mean score at `uncertain`. The pace that all rules share has the highest sum
  of scores of those that believe the least, each relative to the pace in use; one is found for the other in turn.
* The planner has one reserve for OutAndBack and Survey: that with the highest sum of scores at `uncertain` and `harsh`,
  each relative to the best there, of those with which at most 0.3 % strand at `uncertain`; and, found in the same way,
  another for Patrol, where it goes by another rule.
* The shield has the risk of a decision with which a robot that never turns back scores most on OutAndBack, of those
  with which at most 0.05 % of its missions strand, at `uncertain` and `harsh`, in forecast and in hidden winds.

Finished trials are kept in OUT/tune.json, so that a run that was killed goes on.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numba
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.kept import Kept
from benchmarks.tables import rate, table
from homeward import cli
from homeward.agents.base import Policy
from homeward.agents.evaluation import run_episodes
from homeward.agents.planner import Planner
from homeward.agents.rules.dmax import DmaxRule
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.dmax_belief import BeliefDmaxRule
from homeward.agents.rules.dmax_mapped import MappedDmaxRule
from homeward.agents.rules.pace import NO_SENSING, Pace
from homeward.agents.rules.reserves import PACES
from homeward.agents.rules.soc50 import StateOfChargeRule
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward
from homeward.envs.options import MISSIONS, Known, OptionError, Options, known_of
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND
from homeward.parallel import ClusterError, run_tasks

ROUNDS = 3
"""Of choosing a pace and the reserves for it in turn, unless the pace stays before. Chosen: bounds the time."""
CANDIDATES = [
    Pace(rate, interest, full)
    for rate, interest, full in itertools.product((0.5, 0.75, 1.0), (0.0, 0.4, 0.5, 0.6, 0.8), (0.5, 0.7, 0.9, 0.95))
]
RULES: dict[str, Callable[..., Policy]] = {
    "dmax": DmaxRule, "dmax_mapped": MappedDmaxRule, "dmax_adaptive": AdaptiveDmaxRule, "dmax_belief": BeliefDmaxRule,
}  # fmt: skip
PACED_BY = ("dmax", "dmax_mapped", "dmax_adaptive")
"""Rules whose scores choose the pace, beside `soc50`, whose reserve is in its name."""
_SHARES, _DEVIATIONS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.32), (0.0, 1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0)
NUMBERS = {
    "dmax": _SHARES, "dmax_mapped": _SHARES, "dmax_adaptive": _DEVIATIONS, "dmax_belief": _DEVIATIONS,
    "planner": _DEVIATIONS, "shield": (1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9),
}  # fmt: skip
"""What is tried of each: shares of the usable energy, standard deviations of the margin, risks of each decision."""
PLANNER_STRANDS, SHIELD_STRANDS = 0.003, 0.0005
"""Shares of missions that may strand."""
_FIRST_SEED, _SEEDS_APART = 1 << 62, 1 << 32  # training has smaller ones, evaluation larger


@dataclass(frozen=True)
class Args:
    """What to tune."""

    only: str | None = None
    """Tune one: dmax, dmax_mapped, dmax_adaptive, dmax_belief, planner or shield; then the pace is left as it is."""
    episodes: int = 4096
    """Episodes of each trial."""
    seed: int = 0
    """Number of the set of missions."""
    jobs: int = 1
    """Processes at once."""
    out: Path = Path("runs/tune")
    """Folder of the trials that are finished."""


class Scored(NamedTuple):
    """Mean score and number of stranded missions."""

    score: float
    stranded: int


Grid = dict[float, Scored]
"""What came of each number."""


@dataclass(frozen=True)
class Attempt:
    """An agent with its number in an environment.

    Attributes:
        name: A rule, `planner` or `shield`.
        options: Of the environment.
        number: Reserve; of the shield the risk.
        pace: Of rules.
    """

    name: str
    options: Options
    number: float
    pace: Pace = NO_SENSING

    def policy(self, known: Known) -> Policy:
        """The agent."""
        if self.name == "soc50":
            return StateOfChargeRule(known, self.pace, self.number)
        if self.name == "planner":
            return Planner(known, self.number)
        if self.name == "shield":
            return Shield(Onward(known), known, self.number)
        return RULES[self.name](known, self.pace, self.number)


def run_trial(task: tuple[Attempt, range]) -> Scored:
    """Mean score and strandings of a trial."""
    trial, seeds = task
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    episodes = run_episodes(trial.policy(known_of(trial.options)), trial.options, seeds).episodes
    return Scored(float(episodes.score.mean()), int(episodes.stranded.sum()))


class Tuner:
    """Runs trials, keeps what came of them, and chooses by that."""

    def __init__(self, args: Args) -> None:
        first = _FIRST_SEED + args.seed * _SEEDS_APART
        self._seeds, self._jobs = range(first, first + args.episodes), args.jobs
        self._kept, self._console = Kept(args.out / "tune.json", seeds=[first, args.episodes]), Console(width=120)
        self.say(f"{args.episodes} episodes a trial, seeds from {first}, default robot")

    def say(self, text: str) -> None:
        """Print a line."""
        self._console.print(text, highlight=False, soft_wrap=True)

    def run(self, trials: Iterable[Attempt]) -> list[Scored]:
        """Outcomes of trials, in their order."""
        named = {repr(trial): (trial, self._seeds) for trial in trials}
        run_tasks(run_trial, self._kept.missing(named), jobs=self._jobs, keep=self._kept.keep, title="trials")
        return [Scored(*self._kept.results[name]) for name in named]

    def grid(self, name: str, options: Options, pace: Pace = NO_SENSING) -> Grid:
        """Run an agent with each of its numbers."""
        outcomes = self.run(Attempt(name, options, one, pace) for one in NUMBERS[name])
        return dict(zip(NUMBERS[name], outcomes, strict=True))

    def chosen(self, grids: Mapping[str, Grid], most: float = 1.0, asked: str = "") -> float:
        """Print what came of an agent's numbers by setting, and the one that is best, in bold: see `best_number`."""
        found = best_number(grids, len(self._seeds), most, asked)
        shown = table("", ("",), ("number", "score", "stranded (95 %)"))
        for name, grid in grids.items():
            for number, outcome in grid.items():
                stranded = rate(outcome.stranded, len(self._seeds))
                style = "bold" if number == found else ""
                shown.add_row(name, f"{number:g}", f"{outcome.score:.4g}", stranded, style=style)
        self._console.print(shown)
        return found

    def pace(self, mission: str) -> Pace:
        """Find the pace of a mission, and print the ten best."""
        pace, options = PACES[mission], Options(mission, difficulty="uncertain")
        for _ in range(0 if pace == NO_SENSING else ROUNDS):
            reserves = {"soc50": 0.5}
            for name in PACED_BY:
                reserves[name] = best_number({mission: self.grid(name, options, pace)}, len(self._seeds))
            totals = dict.fromkeys(CANDIDATES, 0.0)
            for name, reserve in reserves.items():
                (in_use,) = self.run([Attempt(name, options, reserve, pace)])
                tried = self.run(Attempt(name, options, reserve, one) for one in CANDIDATES)
                for one, outcome in zip(CANDIDATES, tried, strict=True):
                    totals[one] += outcome.score / in_use.score / len(reserves)
            ranked = sorted(totals, key=lambda one: -totals[one])
            shown = table(f"{mission}: mean score over all rules, relative to the pace in use", (), ("pace", "score"))
            for one in ranked[:10]:
                shown.add_row(f"{one.rate:g}, {one.interest:g}, {one.full:g}", f"{totals[one]:.4f}")
            self._console.print(shown)
            if ranked[0] == pace:
                break
            pace = ranked[0]
        return pace


def best_number(grids: Mapping[str, Grid], episodes: int, most: float = 1.0, asked: str = "") -> float:
    """The number with the highest sum of scores over settings, each relative to the best there.

    Args:
        grids: What came of each number, by setting.
        episodes: Of each trial.
        most: Share that may strand in every setting that is asked; where more do with all numbers, the least of them.
        asked: Part of the names of those settings.
    """
    strict = [grid for name, grid in grids.items() if asked in name]
    stranded = {one: max(grid[one].stranded for grid in strict) / episodes for one in strict[0]}
    allowed = [one for one, share in stranded.items() if share <= max(most, min(stranded.values()))]
    # Where nothing is scored, as by a survey that senses nothing, there is nothing to compare.
    scored = [grid for grid in grids.values() if any(outcome.score > 0.0 for outcome in grid.values())]
    scales = [max(outcome.score for outcome in grid.values()) for grid in scored]
    return max(allowed, key=lambda one: sum(g[one].score / scale for g, scale in zip(scored, scales, strict=True)))


def main(args: Args) -> None:
    """Tune, and print what belongs into `agents/rules/reserves.py` and `agents/shield/shield.py`.

    Raises:
        OptionError, ClusterError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.only not in (None, *NUMBERS) or args.episodes < 1 or args.seed < 0:
        raise OptionError(
            f"--only {args.only} --episodes {args.episodes} --seed {args.seed}: choose from {', '.join(NUMBERS)}, and "
            "give at least 1 episode and a seed of 0 or more"
        )
    tuner, paces = Tuner(args), dict(PACES)
    if args.only is None:
        paces = {mission: tuner.pace(mission) for mission in MISSIONS}
        tuner.say(f"PACES = {paces}")
    for name in [args.only] if args.only else NUMBERS:
        reserves: dict[str, float] = {}
        for mission in MISSIONS if name in RULES else ():
            grid = tuner.grid(name, Options(mission, difficulty="uncertain"), paces[mission])
            reserves[mission] = tuner.chosen({f"{name}, {mission}, uncertain": grid})
        for missions in (("OutAndBack", "Survey"), ("Patrol",)) if name == "planner" else ():
            grids = {
                f"planner, {mission}, {difficulty}": tuner.grid(name, Options(mission, difficulty=difficulty))
                for mission, difficulty in itertools.product(missions, ("uncertain", "harsh"))
            }
            reserves |= dict.fromkeys(missions, tuner.chosen(grids, PLANNER_STRANDS, "uncertain"))
        if name == "shield":
            grids = {
                f"onward+shield, {difficulty}, {route}": tuner.grid(
                    name, Options("OutAndBack", difficulty=difficulty, route=route)
                )
                for difficulty, route in itertools.product(("uncertain", "harsh"), (GENERATED, HIDDEN_WIND))
            }
            tuner.say(f"RISK = {tuner.chosen(grids, SHIELD_STRANDS):g}")
        else:
            tuner.say(f'"{name}": {json.dumps(reserves)},')


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, ClusterError)))
