"""The three missions: what a robot does at the end of the route, what it scores, and what more it may hope for."""

from __future__ import annotations

from typing import Any

from homeward.envs.state import OUT_AND_BACK, PATROL, SURVEY
from homeward.physics.jit import inline

DRIVING_LINK = 0.5
"""Share of its rate that the radio keeps while driving: antennas move and the channel fades."""


_ANY = 1e-9  # samples, against a division by none


@inline
def information(interest: float, new_m: float, samples: float, way_m: float, half_per_m: float) -> Any:
    """Information from the new metres of a stretch: interest times n / (n + n_half) a metre, n samples per metre.

    Args:
        interest: Weight of the ground.
        new_m: Metres of the stretch that the robot had not reached before.
        samples: Taken on the stretch.
        way_m: Length of the stretch.
        half_per_m: Samples per metre that give half of the information.
    """
    return interest * new_m * samples / max(samples + half_per_m * way_m, _ANY)


@inline
def fading(distance_m: float, per_half_m: float) -> Any:
    """By how much the radio is slower at a distance from base: 1 + (r / r_half)^2, as power falls in free space."""
    ratio = distance_m * per_half_m
    return 1.0 + ratio * ratio


@inline
def sense(m: Any, place: Any, shared: Any, samples: float, way_m: float, new_m: float) -> None:
    """Take samples along a stretch: their information goes on board, and what does not fit is lost."""
    found = information(place.interest, new_m, samples, way_m, shared.saturation_per_m)
    if m.backlog + samples > shared.backlog_limit:
        lost = found * (m.backlog + samples - shared.backlog_limit) / samples
        m.lost += lost
        found -= lost
        samples = shared.backlog_limit - m.backlog
    m.backlog += samples
    m.backlog_information += found


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
