"""The reward: the score of a mission, and the potential that shapes it.

A decision that brings the robot home is rewarded with the score over that of a good mission. Every
decision is rewarded with `discount * potential after - potential before`, which does not change the
ranking of policies (Ng, Harada, Russell, Policy invariance under reward transformations, ICML
1999). The potential uses the true energy, the true way home and the interest ahead, not readings.
It is a function of the mission's state, as the theorem requires, and is available in training only.
"""

from __future__ import annotations

from typing import Any

from homeward.envs.missions import by_mission
from homeward.physics.jit import inline

TERMS = ("score", "shaping")
"""Terms of the reward, which is their sum."""


score = by_mission("score", "mission, shared")
"""Score of the mission once the robot is home: furthest distance (m), information, or laps."""
_attainable = by_mission("attainable", "mission, route, shared, margin_j")


@inline
def attainable(mission: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Score that the mission may still add with energy beyond the way home; none once it
    returns."""
    if mission.returning:
        return 0.0
    return _attainable(mission, route, shared, margin_j)


@inline
def potential(mission: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Potential of a state, from d_max: the score so far and the attainable score, if the way home
    is still possible.

    It falls to zero as the energy falls short of the way home by a fiftieth of the battery (chosen:
    four decisions at cruise): in training, a turn that is too late is penalised at once.
    """
    fits = min(max(1.0 + 50.0 * margin_j * shared.per_usable_j, 0.0), 1.0)
    return fits * (mission.score + attainable(mission, route, shared, margin_j)) * shared.per_score


@inline
def reward(mission: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Score a mission after a decision, store the terms of the reward, and return their sum.

    Args:
        mission: Mission record.
        route: Route record.
        shared: Shared record.
        margin_j: True energy beyond the true way home, J.
    """
    if mission.depleted:
        mission.score = 0.0
        mission.cost = 1.0
    else:
        mission.score = score(mission, shared)
        mission.cost = 0.0
    mission.score_reward = 0.0
    if mission.home:
        mission.score_reward = mission.score * shared.per_score
    if shared.shaped:
        # The end of a mission has no potential, so that the shaping changes no policy.
        new_potential = 0.0
        if not (mission.home or mission.depleted):
            new_potential = potential(mission, route, shared, margin_j)
        mission.shaping_reward = shared.discount * new_potential - mission.potential
        mission.potential = new_potential
    return mission.score_reward + mission.shaping_reward
