"""Tune the parameters of rules, planner and shield: the numbers of `reserves.py` and of the shield.

`python benchmarks/agents/tune.py` prints the tables and the numbers. All agents get the same number
of trials. The seeds of the missions occur neither in training nor in evaluation; the robot is the
default one, and stranded robots score 0.

* Each rule gets the reserve with the highest mean score at `uncertain`. The pace, which all rules
  share, maximises the sum of scores of `PACED_BY`, each relative to the pace in use. Reserves and
  pace are tuned in turn.
* The planner gets one reserve for OutAndBack and Survey: of those with at most 0.3 % stranded at
  `uncertain`, that with the highest sum of scores at `uncertain` and `harsh`, each relative to the
  best there. In the same way it gets another for Patrol, where another rule decides when to turn.
* The shield gets the risk per decision with which a policy that never turns back has the highest
  score on OutAndBack, of those with at most 0.05 % stranded at `uncertain` and `harsh`, in forecast
  and in hidden winds.

Finished trials are stored in OUT/tune.json, so that an interrupted run continues.
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

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

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
from homeward.envs.missions import MISSIONS
from homeward.envs.options import Known, OptionError, Options, known_of
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND
from homeward.parallel import ClusterError, run_tasks

ROUNDS = 3
"""Of choosing a pace and the reserves for it in turn, unless the pace stays before. Chosen: bounds
the time."""
CANDIDATES = [
    Pace(rate, interest, full)
    for rate, interest, full in itertools.product(
        (0.5, 0.75, 1.0), (0.0, 0.4, 0.5, 0.6, 0.8), (0.5, 0.7, 0.9, 0.95)
    )
]
RULES: dict[str, Callable[..., Policy]] = {
    "dmax": DmaxRule, "dmax_mapped": MappedDmaxRule, "dmax_adaptive": AdaptiveDmaxRule, "dmax_belief": BeliefDmaxRule,
}  # fmt: skip
PACED_BY = ("dmax", "dmax_mapped", "dmax_adaptive")
"""Rules whose scores choose the pace, beside `soc50`, whose reserve is in its name."""
_SHARES, _DEVIATIONS = (
    (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.32),
    (0.0, 1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0),
)
NUMBERS = {
    "dmax": _SHARES, "dmax_mapped": _SHARES, "dmax_adaptive": _DEVIATIONS, "dmax_belief": _DEVIATIONS,
    "planner": _DEVIATIONS, "shield": (1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9),
}  # fmt: skip
"""What is tried of each: shares of the usable energy, standard deviations of the margin, risks of
each decision."""
PLANNER_STRANDS, SHIELD_STRANDS = 0.003, 0.0005
"""Shares of missions that may strand."""
_FIRST_SEED, _SEEDS_APART = 1 << 62, 1 << 32  # training has smaller ones, evaluation larger


@dataclass(frozen=True)
class Args:
    """What to tune."""

    only: str | None = None
    """Tune one: dmax, dmax_mapped, dmax_adaptive, dmax_belief, planner or shield; then the pace is
    left as it is."""
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
"""Result for each value of a parameter."""


@dataclass(frozen=True)
class Attempt:
    """An agent with a value of its parameter in an environment.

    Attributes:
        name: A rule, `planner` or `shield`.
        options: Options of the environment.
        number: Value: the reserve, or the risk of the shield.
        pace: Pace of rules.
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
    numba.set_num_threads(1)  # steps are short: several threads would be slower
    episodes = run_episodes(trial.policy(known_of(trial.options)), trial.options, seeds).episodes
    return Scored(float(episodes.score.mean()), int(episodes.stranded.sum()))


class Tuner:
    """Runs trials, stores their results, and chooses the best."""

    def __init__(self, args: Args) -> None:
        start = _FIRST_SEED + args.seed * _SEEDS_APART
        self._seeds = range(start, start + args.episodes)
        self._jobs = args.jobs
        self._kept = Kept(args.out / "tune.json", seeds=[start, args.episodes])
        self._console = Console(width=120)
        self.say(f"{args.episodes} episodes a trial, seeds from {start}, default robot")

    def say(self, text: str) -> None:
        """Print a line."""
        self._console.print(text, highlight=False, soft_wrap=True)

    def run(self, trials: Iterable[Attempt]) -> list[Scored]:
        """Results of trials, in their order."""
        named = {repr(trial): (trial, self._seeds) for trial in trials}
        run_tasks(
            run_trial,
            self._kept.missing(named),
            jobs=self._jobs,
            keep=self._kept.keep,
            title="trials",
        )
        return [Scored(*self._kept.results[name]) for name in named]

    def grid(self, name: str, options: Options, pace: Pace = NO_SENSING) -> Grid:
        """Run an agent with each value of its parameter."""
        outcomes = self.run(Attempt(name, options, number, pace) for number in NUMBERS[name])
        return dict(zip(NUMBERS[name], outcomes, strict=True))

    def chosen(self, grids: Mapping[str, Grid], most: float = 1.0, asked: str = "") -> float:
        """Print the results of an agent's values by environment, the best in bold, see
        `best_number`."""
        best = best_number(grids, len(self._seeds), most, asked)
        shown = table("", ("",), ("number", "score", "stranded (95 %)"))
        for name, grid in grids.items():
            for number, outcome in grid.items():
                stranded = rate(outcome.stranded, len(self._seeds))
                style = "bold" if number == best else ""
                shown.add_row(name, f"{number:g}", f"{outcome.score:.4g}", stranded, style=style)
        self._console.print(shown)
        return best

    def pace(self, mission: str) -> Pace:
        """Find the pace of a mission, and print the ten best."""
        pace = PACES[mission]
        options = Options(mission, difficulty="uncertain")
        for _ in range(0 if pace == NO_SENSING else ROUNDS):
            reserves = {"soc50": 0.5}
            for name in PACED_BY:
                reserves[name] = best_number(
                    {mission: self.grid(name, options, pace)}, len(self._seeds)
                )
            totals = dict.fromkeys(CANDIDATES, 0.0)
            for name, reserve in reserves.items():
                (in_use,) = self.run([Attempt(name, options, reserve, pace)])
                outcomes = self.run(
                    Attempt(name, options, reserve, candidate) for candidate in CANDIDATES
                )
                for candidate, outcome in zip(CANDIDATES, outcomes, strict=True):
                    totals[candidate] += outcome.score / in_use.score / len(reserves)
            ranked = sorted(totals, key=lambda candidate: -totals[candidate])
            shown = table(
                f"{mission}: mean score over all rules, relative to the pace in use",
                (),
                ("pace", "score"),
            )
            for candidate in ranked[:10]:
                numbers = f"{candidate.rate:g}, {candidate.interest:g}, {candidate.full:g}"
                shown.add_row(numbers, f"{totals[candidate]:.4f}")
            self._console.print(shown)
            if ranked[0] == pace:
                break
            pace = ranked[0]
        return pace


def best_number(
    grids: Mapping[str, Grid], episodes: int, most: float = 1.0, asked: str = ""
) -> float:
    """The value with the highest sum of scores over environments, each relative to the best there.

    Args:
        grids: Result for each value, by environment.
        episodes: Episodes of each trial.
        most: Share that may strand in each constrained environment; if all exceed it, the lowest
            rate is allowed.
        asked: Part of the names of the constrained environments.
    """
    constrained = [grid for name, grid in grids.items() if asked in name]
    stranded = {}  # the largest rate, by value
    for number in constrained[0]:
        stranded[number] = max(grid[number].stranded for grid in constrained) / episodes
    limit = max(most, min(stranded.values()))
    allowed = [number for number, rate_of_number in stranded.items() if rate_of_number <= limit]
    totals = dict.fromkeys(allowed, 0.0)
    for grid in grids.values():
        highest = max(outcome.score for outcome in grid.values())
        if highest <= 0.0:
            # environments without any score, such as a survey without sensing, are not compared
            continue
        for number in allowed:
            totals[number] += grid[number].score / highest
    return max(allowed, key=lambda number: totals[number])


def main(args: Args) -> None:
    """Tune, and print the numbers for `agents/rules/reserves.py` and `agents/thresholds.py`.

    Raises:
        OptionError, ClusterError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.only not in (None, *NUMBERS) or args.episodes < 1 or args.seed < 0:
        raise OptionError(
            f"--only {args.only} --episodes {args.episodes} --seed {args.seed}: choose from {', '.join(NUMBERS)}, and "
            "give at least 1 episode and a seed of 0 or more"
        )
    tuner = Tuner(args)
    paces = dict(PACES)
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
                f"planner, {mission}, {difficulty}": tuner.grid(
                    name, Options(mission, difficulty=difficulty)
                )
                for mission, difficulty in itertools.product(missions, ("uncertain", "harsh"))
            }
            reserves |= dict.fromkeys(missions, tuner.chosen(grids, PLANNER_STRANDS, "uncertain"))
        if name == "shield":
            grids = {
                f"onward+shield, {difficulty}, {route}": tuner.grid(
                    name, Options("OutAndBack", difficulty=difficulty, route=route)
                )
                for difficulty, route in itertools.product(
                    ("uncertain", "harsh"), (GENERATED, HIDDEN_WIND)
                )
            }
            tuner.say(f"RISK = {tuner.chosen(grids, SHIELD_STRANDS):g}")
        else:
            tuner.say(f'"{name}": {json.dumps(reserves)},')


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, ClusterError)))
