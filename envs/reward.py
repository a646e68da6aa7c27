"""The reward: the score of a mission, and the potential that shapes it.

A decision that brings the robot home is rewarded with the score over that of a good mission. Every decision is rewarded
with `discount * potential after - potential before`, which does not change the ranking of policies (Ng, Harada,
Russell, Policy invariance under reward transformations, ICML 1999). The potential uses the true energy, the true way
home and the interest ahead, not readings. It is a function of the mission's state, as the theorem requires, and is
available in training only.
"""

from __future__ import annotations

from typing import Any

from homeward.envs import sensing
from homeward.envs.state import OUT_AND_BACK, PATROL, SURVEY
from homeward.physics.jit import inline

TERMS = ("score", "shaping")
"""Terms of the reward, which is their sum."""


@inline
def score(m: Any, shared: Any) -> Any:
    """Score of the mission once the robot is home: furthest distance (m), information, or laps."""
    if shared.mission == OUT_AND_BACK:
        return m.furthest_m
    if shared.mission == SURVEY:
        return m.delivered + m.backlog_information
    return 0.5 * m.legs


@inline
def attainable(m: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Score that the mission may still add with energy beyond the way home, by the range it allows (Eq. 8)."""
    if m.returning:
        return 0.0
    if shared.mission == PATROL:
        return 0.5 * max(margin_j, 0.0) * shared.per_energy_per_m / shared.length_m
    # Out as the mission drives on average, and home without sensing.
    out_m = max(margin_j, 0.0) * shared.per_out_and_home_j_per_m
    room_m = min(out_m, shared.length_m - m.position_m)
    if shared.mission == OUT_AND_BACK:
        return max(m.position_m + room_m - m.furthest_m, 0.0)
    return _findable(m, route, shared, room_m)


@inline
def _findable(m: Any, route: Any, shared: Any, way_m: float) -> Any:
    """Information ahead, sensed evenly, and as often as memory and radio allow."""
    radio_hz = sensing.DRIVING_LINK * shared.radio_hz / sensing.fading(m.position_m, shared.per_link_m)
    room = shared.backlog_limit - m.backlog + radio_hz * way_m / shared.cruise_mps
    samples = min(room, shared.max_sensing_hz * way_m / shared.cruise_mps)
    end_m = m.position_m + way_m
    last = route.places[min(int(end_m * shared.per_place_m), shared.places - 1)]
    interest = last.interest_to_here + last.interest * end_m
    interest -= m.here.interest_to_here + m.here.interest * m.position_m
    return sensing.information(interest, 1.0, samples, way_m, shared.saturation_per_m)


@inline
def potential(m: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Potential of a state, from d_max: the score so far and the attainable score, if the way home is still possible.

    It falls to zero as the energy falls short of the way home by a fiftieth of the battery (chosen: four decisions at
    cruise): in training, a turn that is too late is penalised at once.
    """
    fits = min(max(1.0 + 50.0 * margin_j * shared.per_usable_j, 0.0), 1.0)
    return fits * (m.score + attainable(m, route, shared, margin_j)) * shared.per_score


@inline
def reward(m: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Score a mission after a decision, store the terms of the reward, and return their sum.

    Args:
        m: Mission record.
        route: Route record.
        shared: Shared record.
        margin_j: True energy beyond the true way home, J.
    """
    m.score = 0.0 if m.depleted else score(m, shared)
    m.cost = 1.0 if m.depleted else 0.0
    m.score_reward = m.score * shared.per_score if m.home else 0.0
    if shared.shaped:
        after = 0.0 if m.home or m.depleted else potential(m, route, shared, margin_j)
        m.shaping_reward = shared.discount * after - m.potential
        m.potential = after
    return m.score_reward + m.shaping_reward
