"""Everything that a picture or a text of a mission shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Scene:
    """A moment of a mission. The viewer shows true values, and labels the robot's own estimates.

    Attributes:
        heading: Mission, difficulty and robot.
        mission: `OutAndBack`, `Survey` or `Patrol`.
        state: `ready`, `out`, `back` (of one that shuttles), `stopped`, `pit stop`, `returning`,
            `home`, `stranded` or `out of time`.
        over: Whether the mission is over.
        decision: Decisions taken.
        max_decisions: Decisions until the time limit.
        time_s: Time since the start, s.
        edges_m: Ends of the route's places, shape (places + 1,).
        elevation_m: Elevation above home there, m, shape (places + 1,).
        rough: Additional rolling resistance of the ground over the robot's file, as a share, shape
            (places,).
        interest: Interest of the ground, shape (places,).
        sensed: Stretches in which new ground was reached: from (m), to (m), share of the
            information that the sensing rate yields there; shape (stretches, 3).
        driven_m: Distance up to which the ground was driven, m.
        position_m: Distance from home along the route, m.
        furthest_m: The furthest so far, m.
        direction: 1 away from home, -1 towards it, also during a return that is not final.
        no_return_m: Point of no return by the robot's own model, m; None where there is none, see
            `PointOfNoReturn`.
        runs_out_m: Where the battery will be empty on the way home by the robot's own model; None
            if it gets home.
        laps_left: Laps that a mission that shuttles may add by the robot's own model, None for
            others.
        full_j: Energy of a full battery by the robot's file, J.
        worn_j: Difference to the true energy of a full battery, J.
        left_j: Energy left, J.
        gauge_j: Energy left by the state-of-charge reading, J.
        home_j: Energy of the way home by the robot's own model, J.
        margin_j: Energy by the power meter beyond that, J: the d_max margin.
        read_w: Mean power over the last decision by the power meter, W.
        used_j: Energy used, J, by the names of `GROUPS`.
        power_w: Mean power over the last decision, W.
        speed_mps: Speed of the last decision, m/s; 0 once the mission is over, like the rate below.
        max_speed_mps: The fastest, m/s.
        sensing_hz: Sensing rate of the last decision, Hz.
        max_sensing_hz: The fastest, Hz.
        memory: Share of the memory that samples on board take.
        on_board: Information in them.
        delivered: Information sent home by radio.
        lost: Information that did not fit on board.
        sending: Whether the radio sent anything in the last decision.
        score: Score if the robot were home now.
        good_score: Score of a good mission.
        headwind_mps: Wind against the direction of travel, m/s.
        temperature_c: Air temperature, C.
    """

    heading: str
    mission: str
    state: str
    over: bool
    decision: int
    max_decisions: int
    time_s: float
    edges_m: NDArray[np.float64]
    elevation_m: NDArray[np.float64]
    rough: NDArray[np.float64]
    interest: NDArray[np.float64]
    sensed: NDArray[np.float64]
    driven_m: float
    position_m: float
    furthest_m: float
    direction: float
    no_return_m: float | None
    runs_out_m: float | None
    laps_left: float | None
    full_j: float
    worn_j: float
    left_j: float
    gauge_j: float
    home_j: float
    margin_j: float
    read_w: float
    used_j: Mapping[str, float]
    power_w: float
    speed_mps: float
    max_speed_mps: float
    sensing_hz: float
    max_sensing_hz: float
    memory: float
    on_board: float
    delivered: float
    lost: float
    sending: bool
    score: float
    good_score: float
    headwind_mps: float
    temperature_c: float

    @property
    def length_m(self) -> float:
        """Length of the route, m."""
        return float(self.edges_m[-1])
