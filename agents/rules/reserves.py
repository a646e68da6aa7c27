"""Parameters of the baselines for each mission, found by `python benchmarks/agents/tune.py`.

Eight values of each are tried on seeds that neither training nor evaluation uses, at `uncertain`,
with the default robot: on 2,048 missions, and on 4,096 for the planner, whose choice depends on the
few strandings. A rule has the reserve with the highest mean score. The planner has one for
OutAndBack and Survey: with the highest sum of scores over both at `uncertain` and `harsh`, relative
to the best of each, with no more than 0.3 % stranded at `uncertain`. On Patrol, where it uses
another rule, its reserve is found in the same way. With the gauges of `harsh` the planner was tuned
again, at `harsh` on 1,024 missions: a larger reserve on Patrol, and the same elsewhere.
"""

from __future__ import annotations

from homeward.agents.rules.pace import NO_SENSING, Pace
from homeward.envs.missions import MISSIONS

PACES = {
    "OutAndBack": NO_SENSING,
    "Survey": Pace(rate=1.0, interest=0.4, full=0.95),
    "Patrol": NO_SENSING,
}
"""Speed and sensing rate, the same for all rules, found with the reserves."""

RESERVES = {
    "dmax": {"OutAndBack": 0.25, "Survey": 0.15, "Patrol": 0.03},
    "dmax_mapped": {"OutAndBack": 0.2, "Survey": 0.15, "Patrol": 0.03},
    "dmax_adaptive": {"OutAndBack": 2.0, "Survey": 2.0, "Patrol": 0.0},
    "dmax_belief": {"OutAndBack": 3.0, "Survey": 2.0, "Patrol": 1.0},
    "planner": {"OutAndBack": 5.0, "Survey": 5.0, "Patrol": 3.0},
}
"""Reserves: shares of the usable energy; of `dmax_adaptive`, `dmax_belief` and `planner` standard
deviations of the margin."""


def pace_of(mission: str) -> Pace:
    """Pace of a mission, or of that which it names as `tuned_as`.

    Raises:
        KeyError: It has neither.
    """
    return PACES[_tuned_as(mission)]


def reserve_of(rule: str, mission: str) -> float:
    """Reserve of a rule on a mission, or on that which it names as `tuned_as`.

    Raises:
        KeyError: It has neither.
    """
    return RESERVES[rule][_tuned_as(mission)]


def _tuned_as(mission: str) -> str:
    return MISSIONS[mission].tuned_as or mission
