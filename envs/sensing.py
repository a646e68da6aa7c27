"""Information: collected where the robot drives and senses, stored on board while there is room,
and sent by radio."""

from __future__ import annotations

from typing import Any

from homeward.physics.jit import inline

DRIVING_LINK = 0.5
"""Share of the radio's rate while driving: antennas move and the channel fades. Chosen: 3 dB."""
_ANY = 1e-9  # samples, against a division by zero; chosen: far below one


@inline
def information(
    interest: float, new_m: float, samples: float, way_m: float, half_per_m: float
) -> Any:
    """Information from the new metres of a stretch: interest times n / (n + n_half) a metre, n
    samples per metre.

    Args:
        interest: Weight of the ground.
        new_m: Metres of the stretch that the robot had not reached before.
        samples: Samples taken on the stretch.
        way_m: Length of the stretch.
        half_per_m: Samples per metre that give half of the information.
    """
    return interest * new_m * samples / max(samples + half_per_m * way_m, _ANY)


@inline
def fading(distance_m: float, per_half_m: float) -> Any:
    """Factor by which the radio is slower at a distance from base: 1 + (r / r_half)^2, as power
    falls in free space."""
    ratio = distance_m * per_half_m
    return 1.0 + ratio * ratio


@inline
def sense(
    mission: Any, place: Any, shared: Any, samples: float, way_m: float, new_m: float
) -> None:
    """Take samples along a stretch: their information is stored on board, and what does not fit is
    lost."""
    gathered = information(place.interest, new_m, samples, way_m, shared.saturation_per_m)
    if mission.backlog + samples > shared.backlog_limit:
        lost = gathered * (mission.backlog + samples - shared.backlog_limit) / samples
        mission.lost += lost
        gathered -= lost
        samples = shared.backlog_limit - mission.backlog
    mission.backlog += samples
    mission.backlog_information += gathered


@inline
def transmit(mission: Any, shared: Any, moving: bool, passed_s: float) -> None:
    """Send samples home for a while: slower far from base and while driving."""
    near_base = shared.radio_hz * passed_s * (DRIVING_LINK if moving else 1.0)
    share = min(
        near_base / (fading(mission.position_m, shared.per_link_m) * max(mission.backlog, _ANY)),
        1.0,
    )
    sent = share * mission.backlog_information
    mission.delivered += sent
    mission.backlog_information -= sent
    mission.backlog -= share * mission.backlog
