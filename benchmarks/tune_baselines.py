"""Tune the baselines: the numbers of `agents/rules/tuned.py`, by grid search over mean scores.

`python benchmarks/tune_baselines.py` prints the tables and the numbers in about ten minutes. Missions are those of
training seeds, at difficulty `uncertain` with the default robot; a stranded robot scores 0. The pace has the highest
sum of all rules' scores, each relative to the pace in use; the reserves are those that suit each rule best at that
pace. One is found for the other in turn, beginning with the pace in use. The planner has a pace of its own, and one
reserve for OutAndBack and Survey: that with the highest sum of scores at `uncertain` and `harsh`, each relative to the
best there; and, found in the same way, another for Patrol, where it counts laps.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import TypeVar

import numba
from rich.console import Console
from rich.progress import track
from rich.table import Table

from homeward.agents.base import Policy
from homeward.agents.evaluation import run_episodes
from homeward.agents.planner import Planner
from homeward.agents.rules.dmax import DmaxRule
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.dmax_mapped import MappedDmaxRule
from homeward.agents.rules.pace import NO_SENSING, Pace
from homeward.agents.rules.soc50 import StateOfChargeRule
from homeward.agents.rules.tuned import PACES
from homeward.envs.options import Known, Options, known_of

EPISODES = 1024
ROUNDS = 3
CANDIDATES = [
    Pace(rate, interest, full)
    for rate, interest, full in itertools.product((0.5, 0.75, 1.0), (0.0, 0.4, 0.5, 0.6, 0.8), (0.5, 0.7, 0.9, 0.95))
]
SHARES = (0.0, 0.01, 0.02, 0.03, 0.04, 0.07, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.22, 0.24, 0.26, 0.28, 0.3)
DEVIATIONS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0)
RULES: dict[str, tuple[Callable[..., Policy], tuple[float, ...]]] = {
    "soc50": (StateOfChargeRule, (0.5,)),
    "dmax": (DmaxRule, SHARES),
    "dmax_mapped": (MappedDmaxRule, SHARES),
    "dmax_adaptive": (AdaptiveDmaxRule, DEVIATIONS),
}
"""Each rule and the reserves to try; that of `soc50` is in its name."""

Choice = TypeVar("Choice")
Tables = dict[str, dict[float, tuple[float, float]]]
"""Mean score and stranding rate by rule and reserve."""


def trial(mission: str, rule: str, pace: Pace, reserve: float) -> tuple[float, float]:
    """Mean score and stranding rate of a rule."""
    return outcome(Options(mission, difficulty="uncertain"), lambda known: RULES[rule][0](known, pace, reserve))


def outcome(options: Options, make: Callable[[Known], Policy]) -> tuple[float, float]:
    """Mean score and stranding rate of an agent."""
    episodes = run_episodes(make(known_of(options)), options, range(EPISODES)).episodes
    return float(episodes.score.mean()), float(episodes.stranded.mean())


def tune_planner(*missions: str) -> tuple[Tables, float]:
    """Run the planner with every reserve, and choose the best over missions and two difficulties.

    Where it can identify all that is hidden, it hardly needs a reserve: what one is worth shows at `harsh`.
    """
    tables = {
        f"planner, {mission}, {difficulty}": {
            one: outcome(Options(mission, difficulty=difficulty), functools.partial(Planner, deviations=one))
            for one in DEVIATIONS
        }
        for mission, difficulty in itertools.product(missions, ("uncertain", "harsh"))
    }
    most = {name: max(score for score, _ in table.values()) for name, table in tables.items()}
    return tables, best({one: sum(table[one][0] / most[name] for name, table in tables.items()) for one in DEVIATIONS})


def tune(mission: str, console: Console) -> tuple[Pace, dict[str, float]]:
    """Find pace and reserves of a mission, and print what they were chosen from."""
    pace = PACES[mission]
    tables = try_reserves(mission, pace)
    for _ in range(0 if pace == NO_SENSING else ROUNDS):
        reserves = best_reserves(tables)
        scale = {rule: tables[rule][reserve][0] for rule, reserve in reserves.items()}
        totals = {}
        for one in track(CANDIDATES, description=f"{mission}: pace", console=console, transient=True):
            shares = [trial(mission, rule, one, reserve)[0] / scale[rule] for rule, reserve in reserves.items()]
            totals[one] = sum(shares) / len(shares)
        console.print(pace_table(mission, totals))
        if best(totals) == pace:
            break
        pace = best(totals)
        tables = try_reserves(mission, pace)
    chosen = best_reserves(tables)
    console.print(reserve_table(mission, tables, chosen))
    return pace, chosen


def try_reserves(mission: str, pace: Pace) -> Tables:
    """Run every rule with every reserve."""
    return {rule: {one: trial(mission, rule, pace, one) for one in grid} for rule, (_, grid) in RULES.items()}


def best(scores: dict[Choice, float]) -> Choice:
    """The choice with the highest score."""
    return max(scores, key=lambda choice: scores[choice])


def best_reserves(tables: Tables) -> dict[str, float]:
    """The best reserve of each rule."""
    return {rule: best({reserve: score for reserve, (score, _) in table.items()}) for rule, table in tables.items()}


def pace_table(mission: str, totals: dict[Pace, float]) -> Table:
    """The ten best paces."""
    table = Table(title=f"{mission}: mean score over all rules, relative to the pace in use")
    for heading in ("rate", "interest", "full", "score"):
        table.add_column(heading, justify="right")
    for pace in sorted(totals, key=lambda one: -totals[one])[:10]:
        table.add_row(f"{pace.rate:g}", f"{pace.interest:g}", f"{pace.full:g}", f"{totals[pace]:.4f}")
    return table


def reserve_table(mission: str, tables: Tables, chosen: dict[str, float]) -> Table:
    """Score and stranding rate of every rule and reserve."""
    table = Table(title=f"{mission}: score and stranding rate by reserve")
    for heading in ("rule", "reserve", "score", "stranded"):
        table.add_column(heading, justify="left" if heading == "rule" else "right")
    for rule, results in tables.items():
        for reserve, (score, stranded) in results.items():
            style = "bold" if reserve == chosen[rule] else ""
            table.add_row(rule, f"{reserve:g}", f"{score:.4g}", f"{stranded:.1%}", style=style)
    return table


def main() -> None:
    """Tune all missions and print what belongs into `agents/rules/tuned.py`."""
    numba.set_num_threads(1)  # missions are short: threads that wait for each other cost more than they give
    console = Console()
    tuned = {mission: tune(mission, console) for mission in ("OutAndBack", "Survey", "Patrol")}
    for mission, (pace, reserves) in tuned.items():
        console.print(f"{mission}: {pace}, {reserves}", highlight=False, soft_wrap=True)
    for missions in (("OutAndBack", "Survey"), ("Patrol",)):
        tables, reserve = tune_planner(*missions)
        console.print(reserve_table("Planner", tables, dict.fromkeys(tables, reserve)))
        console.print(f"Planner on {' and '.join(missions)}: {reserve}", highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
