"""A mission: what scores, what it does at the ends of its route, its scale, and the words for it,
in one file each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from homeward.envs.routes.route import GENERATED_PLACES
from homeward.physics.jit import inline

if TYPE_CHECKING:
    from homeward.envs.viewer.scene import Scene


def as_far_as_the_battery_lasts(reach_m: float, decision_m: float) -> float:
    """Length of a generated route of a mission out and back, m; arguments as of
    `Mission.length_m`."""
    return reach_m


def _no_note(scene: Scene) -> str:
    return ""


@dataclass(frozen=True)
class Mission:
    """One mission: its functions, which kernels compile, its properties and its words.

    The functions of a score take the records of a mission, of its route, and the shared one
    (`homeward.envs.state`).

    Attributes:
        name: Name in the id of the environment.
        score: Score if the robot is home, of `(mission, shared)`.
        attainable: Score that it may still add before its return, of
            `(mission, route, shared, margin_j)` with the energy beyond the way home, J; for the
            shaping, by the range that this energy allows (Eq. 8).
        good_score: Score of a good mission, of half the range of the robot (m) and the shared
            record: it scales the reward.
        shuttles: Whether it turns at both ends of the route, after a pit stop there, and not where
            it chooses.
        senses: Whether samples are taken, stored and sent.
        adds_up: Whether the score is a sum over the metres reached for the first time, evenly
            within each place, or the number of laps; the oracle has no bound for others.
        length_m: Length of generated routes, m, of the distance scale (m) and the way of a decision
            at cruise (m).
        places: Places of generated routes.
        pit_stop: Pit stop over the time of a way from one end to the other at cruise; 0 without
            any.
        longest: Longest route, over d_max. A robot comes home from half a d_max; on a route of four
            d_max, cut into `MAX_PLACES`, that is eight places, and on a longer one it would hardly
            leave the first.
        tuned_as: Mission whose tuned pace and reserves the rules take, where it has none of its
            own.
        title: Heading of its picture.
        unit: Unit of the score, empty if it has none.
        scored: What the score measures, with its unit, for the axes of plots.
        note: Line below the score in its picture, of a `Scene`.
    """

    name: str
    score: Callable[[Any, Any], Any]
    attainable: Callable[[Any, Any, Any, float], Any]
    good_score: Callable[[float, Any], float]
    title: str
    unit: str
    scored: str
    adds_up: bool
    shuttles: bool = False
    senses: bool = False
    length_m: Callable[[float, float], float] = as_far_as_the_battery_lasts
    places: int = GENERATED_PLACES
    pit_stop: float = 0.0
    longest: float = 4.0
    tuned_as: str | None = None
    note: Callable[[Scene], str] = _no_note


@inline
def room_m(mission: Any, shared: Any, margin_j: float) -> Any:
    """Metres ahead that the energy beyond the way home allows: out as the mission drives on
    average, home without sensing."""
    out_m = max(margin_j, 0.0) * shared.per_out_and_home_j_per_m
    return min(out_m, shared.length_m - mission.position_m)
