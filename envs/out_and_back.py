"""Out and back: get as far as possible, and home."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from homeward.envs.mission_base import Mission, room_m
from homeward.physics.jit import inline

if TYPE_CHECKING:
    from homeward.envs.viewer.scene import Scene


@inline
def score(m: Any, shared: Any) -> Any:
    """Furthest distance, m."""
    return m.furthest_m


@inline
def attainable(m: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Metres beyond the furthest so far."""
    return max(m.position_m + room_m(m, shared, margin_j) - m.furthest_m, 0.0)


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
