"""The three missions: what a robot does at the end of the route, what it scores, and what more it may hope for."""

from __future__ import annotations

from typing import Any

from homeward.envs.state import OUT_AND_BACK, PATROL, SURVEY
from homeward.physics.jit import inline

DRIVING_LINK = 0.5
"""Share of its rate that the radio keeps while driving: antennas move and the channel fades."""


_ANY = 1e-9  # samples, against a division by none


@inline
def information_gain(interest: float, before_per_m: float, after_per_m: float, half_per_m: float) -> Any:
    """Information that further samples yield from a metre of ground that has some already.

    A metre yields interest times n / (n + n_half): it saturates with the samples taken there. This is the difference.
    """
    return (
        interest
        * half_per_m
        * (after_per_m - before_per_m)
        / ((before_per_m + half_per_m) * (after_per_m + half_per_m))
    )


@inline
def fading(distance_m: float, per_half_m: float) -> Any:
    """By how much the radio is slower at a distance from base: 1 + (r / r_half)^2, as power falls in free space."""
    ratio = distance_m * per_half_m
    return 1.0 + ratio * ratio


@inline
def sense(m: Any, place: Any, shared: Any, sensing_hz: float, passed_s: float) -> None:
    """Take samples for a while: information goes on board, and what does not fit is lost."""
    samples = sensing_hz * passed_s
    before_per_m = place.samples_per_m
    after_per_m = before_per_m + samples * shared.per_place_m
    place.samples_per_m = after_per_m
    gain = information_gain(place.interest, before_per_m, after_per_m, shared.saturation_per_m)
    information = gain * shared.place_m
    if m.backlog + samples > shared.backlog_limit:
        lost = information * (m.backlog + samples - shared.backlog_limit) / samples
        m.lost += lost
        information -= lost
        samples = shared.backlog_limit - m.backlog
    m.backlog += samples
    m.backlog_information += information


@inline
def transmit(m: Any, shared: Any, moving: bool, passed_s: float) -> None:
    """Send samples home for a while: slower far from base and while driving."""
    near_base = shared.radio_hz * passed_s * (DRIVING_LINK if moving else 1.0)
    share = min(near_base / (fading(m.position_m, shared.per_link_m) * max(m.backlog, _ANY)), 1.0)
    sent = share * m.backlog_information
    m.delivered += sent
    m.backlog_information -= sent
    m.backlog -= share * m.backlog


@inline
def arrive(m: Any, shared: Any) -> None:
    """Reach an end of the route: home ends a mission that returns, and a patrol turns round after a pit stop."""
    if shared.mission == PATROL and (m.position_m > 0.0 or m.legs % 2.0 == 1.0):
        m.legs += 1.0
    if m.returning:
        m.home = m.position_m <= 0.0
    elif shared.mission == PATROL:
        m.dwell_s = shared.pit_stop_s
        m.direction = -m.direction


@inline
def score(m: Any, shared: Any) -> Any:
    """What the mission is worth once the robot is home: furthest distance (m), information, or laps."""
    if shared.mission == OUT_AND_BACK:
        return m.furthest_m
    if shared.mission == SURVEY:
        return m.delivered + m.backlog_information
    return 0.5 * m.legs


@inline
def hope(m: Any, shared: Any, spare_j: float) -> Any:
    """What the mission may still add to its score with spare energy, by the range that it buys (Eq. 8)."""
    if m.returning:
        return 0.0
    out_m = 0.5 * max(spare_j, 0.0) * shared.per_energy_per_m
    if shared.mission == PATROL:
        return out_m / shared.length_m
    room_m = min(out_m, shared.length_m - m.position_m)
    if shared.mission == OUT_AND_BACK:
        return max(m.position_m + room_m - m.furthest_m, 0.0)
    return room_m * shared.information_per_m
