"""Survey: gather information along the way, sent by radio or carried home."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from homeward import quantities
from homeward.envs import sensing
from homeward.envs.mission_base import Mission, room_m
from homeward.physics.jit import inline

if TYPE_CHECKING:
    from homeward.envs.viewer.scene import Scene


@inline
def score(mission: Any, shared: Any) -> Any:
    """Information sent and on board."""
    return mission.delivered + mission.backlog_information


@inline
def attainable(mission: Any, route: Any, shared: Any, margin_j: float) -> Any:
    """Information ahead, sensed evenly, and as often as memory and radio allow."""
    way_m = room_m(mission, shared, margin_j)
    radio_hz = (
        sensing.DRIVING_LINK
        * shared.radio_hz
        / sensing.fading(mission.position_m, shared.per_link_m)
    )
    room = shared.backlog_limit - mission.backlog + radio_hz * way_m / shared.cruise_mps
    samples = min(room, shared.max_sensing_hz * way_m / shared.cruise_mps)
    end_m = mission.position_m + way_m
    last_place = route.places[min(int(end_m * shared.per_place_m), shared.places - 1)]
    interest = last_place.interest_to_here + last_place.interest * end_m
    interest -= mission.here.interest_to_here + mission.here.interest * mission.position_m
    return sensing.information(interest, 1.0, samples, way_m, shared.saturation_per_m)


def good_score(half_m: float, shared: Any) -> float:
    """Information of half of the range, at half of the fastest sensing rate."""
    return float(half_m * shared["information_per_m"])


def note(scene: Scene) -> str:
    """Where the information is."""
    return f"sent {quantities.count(scene.delivered)}, on board {quantities.count(scene.on_board)}"


MISSION = Mission(
    name="Survey",
    score=score,
    attainable=attainable,
    good_score=good_score,
    title="Survey",
    unit="",
    scored="information",
    adds_up=True,
    senses=True,
    note=note,
)
