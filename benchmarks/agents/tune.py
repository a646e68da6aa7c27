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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

import numba
from rich.console import Console
from rich.table import Table

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
SHARES = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.32)
"""Reserves of rules, shares of the usable energy."""
DEVIATIONS = (0.0, 1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0)
"""Reserves of rules and planner, standard deviations of the margin."""
DECISION_RISKS = (1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9)
"""Risks of the shield, of each decision. As many of each of the three are tried; which, is chosen."""
RULES: dict[str, tuple[Callable[..., Policy], tuple[float, ...]]] = {
    "dmax": (DmaxRule, SHARES),
    "dmax_mapped": (MappedDmaxRule, SHARES),
    "dmax_adaptive": (AdaptiveDmaxRule, DEVIATIONS),
    "dmax_belief": (BeliefDmaxRule, DEVIATIONS),
}
"""Each rule and the reserves to try."""
PACED_BY = ("soc50", "dmax", "dmax_mapped", "dmax_adaptive")
"""Rules whose scores choose the pace; the reserve of `soc50` is in its name."""
NAMES = (*RULES, "planner", "shield")
PLANNER_STRANDS, SHIELD_STRANDS = 0.003, 0.0005
"""Shares of missions that may strand."""
_FIRST_SEED, _SEEDS_APART = 1 << 62, 1 << 32  # training has smaller ones, evaluation larger

Choice = TypeVar("Choice")


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


@dataclass(frozen=True)
class Attempt:
    """An agent with its numbers in an environment.

    Attributes:
        name: A rule, `planner` or `shield`.
        options: Of the environment.
        numbers: Reserve; of the shield the risk.
        pace: Of rules.
    """

    name: str
    options: Options
    numbers: tuple[float, ...]
    pace: Pace = NO_SENSING

    def policy(self, known: Known) -> Policy:
        """The agent."""
        if self.name == "soc50":
            return StateOfChargeRule(known, self.pace, *self.numbers)
        if self.name == "planner":
            return Planner(known, *self.numbers)
        if self.name == "shield":
            return Shield(Onward(known), known, *self.numbers)
        return RULES[self.name][0](known, self.pace, *self.numbers)


def run_trial(task: tuple[Attempt, range]) -> Scored:
    """Mean score and strandings of a trial."""
    trial, seeds = task
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    episodes = run_episodes(trial.policy(known_of(trial.options)), trial.options, seeds).episodes
    return Scored(float(episodes.score.mean()), int(episodes.stranded.sum()))


class Trials:
    """Runs trials, and keeps what came of them.

    Attributes:
        episodes: Of each.
    """

    def __init__(self, args: Args) -> None:
        first = _FIRST_SEED + args.seed * _SEEDS_APART
        self.episodes, self._seeds, self._jobs = args.episodes, range(first, first + args.episodes), args.jobs
        self._kept = Kept(args.out / "tune.json", seeds=[first, args.episodes])

    def run(self, trials: Iterable[Attempt], title: str) -> list[Scored]:
        """Outcomes of trials, in their order."""
        named = {repr(trial): (trial, self._seeds) for trial in trials}
        run_tasks(run_trial, self._kept.missing(named), jobs=self._jobs, keep=self._kept.keep, title=title)
        return [Scored(*self._kept.results[name]) for name in named]


Grid = Mapping[float, Scored]
"""What came of each reserve."""


def try_reserves(trials: Trials, mission: str, names: Sequence[str], pace: Pace) -> dict[str, Grid]:
    """Run rules with each of their reserves."""
    options = Options(mission, difficulty="uncertain")
    return {
        name: _grid(
            RULES[name][1],
            trials.run((Attempt(name, options, (one,), pace) for one in RULES[name][1]), f"{mission}: {name}"),
        )
        for name in names
    }


def _grid(reserves: Sequence[float], outcomes: Sequence[Scored]) -> Grid:
    return dict(zip(reserves, outcomes, strict=True))


def best(scores: Mapping[Choice, float]) -> Choice:
    """The choice with the highest score, the first of equals."""
    return max(scores, key=lambda choice: scores[choice])


def best_reserve(grid: Grid) -> float:
    """The reserve with the highest mean score."""
    return best({reserve: outcome.score for reserve, outcome in grid.items()})


def tune_pace(trials: Trials, mission: str, console: Console) -> Pace:
    """Find the pace of a mission, and print the best."""
    pace, options = PACES[mission], Options(mission, difficulty="uncertain")
    for _ in range(0 if pace == NO_SENSING else ROUNDS):
        rules = [name for name in PACED_BY if name in RULES]
        grids = try_reserves(trials, mission, rules, pace)
        (half,) = trials.run([Attempt("soc50", options, (0.5,), pace)], f"{mission}: soc50")
        numbers = {"soc50": (0.5, half.score)}
        numbers |= {name: (best_reserve(grid), grid[best_reserve(grid)].score) for name, grid in grids.items()}
        totals = dict.fromkeys(CANDIDATES, 0.0)
        for name, (reserve, scale) in numbers.items():
            tried = (Attempt(name, options, (reserve,), one) for one in CANDIDATES)
            for one, outcome in zip(CANDIDATES, trials.run(tried, f"{mission}: pace, {name}"), strict=True):
                totals[one] += outcome.score / scale / len(numbers)
        console.print(pace_table(mission, totals))
        if best(totals) == pace:
            break
        pace = best(totals)
    return pace


def tune_planner(trials: Trials, missions: Sequence[str]) -> tuple[dict[str, Grid], float]:
    """Run the planner with each reserve, and choose one for some missions: see `choose_for_planner`."""
    grids = {}
    for mission, difficulty in itertools.product(missions, ("uncertain", "harsh")):
        options = Options(mission, difficulty=difficulty)
        tried = (Attempt("planner", options, (one,)) for one in DEVIATIONS)
        name = f"planner, {mission}, {difficulty}"
        grids[name] = _grid(DEVIATIONS, trials.run(tried, name))
    return grids, choose_for_planner(grids, trials.episodes)


def choose_for_planner(grids: Mapping[str, Grid], episodes: int) -> float:
    """The reserve with the most relative score over all settings, of those with which few enough strand at `uncertain`.

    Where there is none, that with which the fewest do.
    """
    asked = [grid for name, grid in grids.items() if name.endswith("uncertain")]
    stranded = {one: max(grid[one].stranded for grid in asked) / episodes for one in asked[0]}
    return _choose(grids, stranded, PLANNER_STRANDS)


def tune_shield(trials: Trials) -> tuple[dict[str, Grid], float]:
    """Run the shield around a robot that never turns back with each risk, and choose."""
    grids = {}
    for difficulty, route in itertools.product(("uncertain", "harsh"), (GENERATED, HIDDEN_WIND)):
        options = Options("OutAndBack", difficulty=difficulty, route=route)
        name = f"{difficulty}, {route}"
        tried = (Attempt("shield", options, (one,)) for one in DECISION_RISKS)
        grids[name] = _grid(DECISION_RISKS, trials.run(tried, f"shield, {name}"))
    return grids, choose_for_shield(grids, trials.episodes)


def choose_for_shield(grids: Mapping[str, Grid], episodes: int) -> float:
    """Risk with the most relative score, of those with which few enough strand in every setting.

    Where there are none, that with which the fewest do.
    """
    first = next(iter(grids.values()))
    stranded = {one: max(grid[one].stranded for grid in grids.values()) / episodes for one in first}
    return _choose(grids, stranded, SHIELD_STRANDS)


def _choose(grids: Mapping[str, Grid], stranded: Mapping[float, float], most: float) -> float:
    allowed = [one for one, share in stranded.items() if share <= max(most, min(stranded.values()))]
    scales = {name: max(outcome.score for outcome in grid.values()) for name, grid in grids.items()}
    # Where nothing is scored, as by a survey that senses nothing, there is nothing to compare.
    return best(
        {one: sum(grids[n][one].score / scale for n, scale in scales.items() if scale > 0.0) for one in allowed}
    )


def pace_table(mission: str, totals: Mapping[Pace, float]) -> Table:
    """The ten best paces."""
    title = f"{mission}: mean score over all rules, relative to the pace in use"
    shown = table(title, (), ("rate", "interest", "full", "score"))
    for pace in sorted(totals, key=lambda one: -totals[one])[:10]:
        shown.add_row(f"{pace.rate:g}", f"{pace.interest:g}", f"{pace.full:g}", f"{totals[pace]:.4f}")
    return shown


def outcome_table(
    title: str, heading: str, grids: Mapping[str, Grid], chosen: Mapping[str, float], episodes: int
) -> Table:
    """Score and stranding rate of each agent or setting by the number that is chosen."""
    shown = table(title, ("",), (heading, "score", "stranded (95 %)"))
    for name, grid in grids.items():
        for number, outcome in grid.items():
            style = "bold" if number == chosen[name] else ""
            stranded = rate(outcome.stranded, episodes)
            shown.add_row(name, f"{number:g}", f"{outcome.score:.4g}", stranded, style=style)
    return shown


def main(args: Args) -> None:
    """Tune, and print what belongs into `agents/rules/reserves.py` and `agents/shield/shield.py`.

    Raises:
        OptionError, ClusterError: An argument cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.only not in (None, *NAMES) or args.episodes < 1 or args.seed < 0:
        raise OptionError(
            f"--only {args.only} --episodes {args.episodes} --seed {args.seed}: choose from {', '.join(NAMES)}, and "
            "give at least 1 episode and a seed of 0 or more"
        )
    console, trials = Console(width=120), Trials(args)
    chosen = [args.only] if args.only else list(NAMES)
    first = _FIRST_SEED + args.seed * _SEEDS_APART
    console.print(f"{args.episodes} episodes a trial, seeds from {first}, default robot", highlight=False)
    reserves: dict[str, dict[str, float]] = {}
    paces = dict(PACES)
    rules = [name for name in chosen if name in RULES]
    for mission in MISSIONS if rules else ():
        if args.only is None:
            paces[mission] = tune_pace(trials, mission, console)
        grids = try_reserves(trials, mission, rules, paces[mission])
        best_ones = {name: best_reserve(grid) for name, grid in grids.items()}
        console.print(outcome_table(f"{mission}, uncertain", "reserve", grids, best_ones, args.episodes))
        for name, reserve in best_ones.items():
            reserves.setdefault(name, {})[mission] = reserve
    for missions in (("OutAndBack", "Survey"), ("Patrol",)) if "planner" in chosen else ():
        found, reserve = tune_planner(trials, missions)
        console.print(outcome_table("planner", "deviations", found, dict.fromkeys(found, reserve), args.episodes))
        reserves.setdefault("planner", {}).update(dict.fromkeys(missions, reserve))
    if args.only is None:
        console.print(f"PACES = {paces}", highlight=False, soft_wrap=True)
    if reserves:
        rows = "".join(f'    "{name}": {json.dumps(by_mission)},\n' for name, by_mission in reserves.items())
        console.print(f"RESERVES = {{\n{rows}}}", highlight=False, soft_wrap=True)
    if "shield" in chosen:
        by_setting, risk = tune_shield(trials)
        risks = dict.fromkeys(by_setting, risk)
        console.print(outcome_table("shield around onward", "risk", by_setting, risks, args.episodes))
        console.print(f"RISK = {risk:g}", highlight=False)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError, ClusterError)))
