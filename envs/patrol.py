"""Patrol: shuttle between two check posts with a pit stop at each, the paper's box and incline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from homeward.envs.mission_base import Mission
from homeward.physics.jit import inline

if TYPE_CHECKING:
    from homeward.envs.viewer.scene import Scene


@inline
def score(mission: Any, shared: Any) -> Any:
    """Laps."""
    return 0.5 * mission.legs


@inline
def attainable(mission: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Laps for which the energy suffices."""
    return 0.5 * max(margin_j, 0.0) * shared.per_energy_per_m / shared.length_m


def good_score(half_m: float, shared: Any) -> float:
    """Laps of the whole range."""
    return float(half_m / shared["length_m"])


def length_m(reach_m: float, decision_m: float) -> float:
    """Distance between the posts, m. Chosen: four decisions at cruise."""
    return 4.0 * decision_m


def note(scene: Scene) -> str:
    """Laps that it may add."""
    if scene.laps_left is None or scene.over:
        return ""
    return f"energy for {scene.laps_left:.1f} more, by its own model"


MISSION = Mission(
    name="Patrol",
    score=score,
    attainable=attainable,
    good_score=good_score,
    title="Patrol",
    unit="laps",
    scored="laps",
    adds_up=True,
    shuttles=True,
    length_m=length_m,
    places=4,  # between the two posts; chosen: a decision passes one at cruise speed
    pit_stop=0.5,
    longest=1.0,  # it must at least reach its far post
    note=note,
)
