"""Out and back: get as far as possible, and home."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from homeward.envs.mission_base import Mission, room_m
from homeward.physics.jit import inline

if TYPE_CHECKING:
    from homeward.envs.viewer.scene import Scene


@inline
def score(mission: Any, shared: Any) -> Any:
    """Furthest distance, m."""
    return mission.furthest_m


@inline
def attainable(mission: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Metres beyond the furthest so far."""
    return max(mission.position_m + room_m(mission, shared, margin_j) - mission.furthest_m, 0.0)


def good_score(half_m: float, shared: Any) -> float:
    """Half of the range, m."""
    return half_m


def note(scene: Scene) -> str:
    """What the score is."""
    return "furthest distance"


MISSION = Mission(
    name="OutAndBack",
    score=score,
    attainable=attainable,
    good_score=good_score,
    title="Out and back",
    unit="m",
    scored="furthest distance, m",
    adds_up=True,
    note=note,
)
