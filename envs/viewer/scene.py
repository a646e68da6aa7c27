"""Everything that a picture or a text of a mission shows, read from its records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.batch import Batch
from homeward.envs.conditions import weather
from homeward.envs.features import home_cost
from homeward.envs.sensing import information
from homeward.envs.viewer.point_of_no_return import PointOfNoReturn
from homeward.physics.kernel import CAUSES

GROUPS: dict[str, tuple[str, ...]] = {
    "rolling": ("rolling", "surface", "air_temperature"),
    "climbing": ("grade", "hidden_grade"),
    "air and wind": ("drag", "wind"),
    "payload": ("payload",),
    "drive losses": (
        "turning", "inertia", "breakaway", "viscous", "slip", "regeneration", "braking", "copper_loss", "no_load",
        "motor_heating",
    ),
    "sensing": ("sensing",),
    "computer": ("computer", "compute"),
    "electronics": ("controller", "communication", "radio", "standby", "heater", "cooler", "intermittent_load"),
    "charger": ("charger",),
    "battery losses": ("internal_resistance", "rate_capacity", "ageing", "cold_battery"),
}  # fmt: skip
"""Causes of the energy ledger under the names that the viewer shows; each cause is in one group."""

_COLUMNS = {name: [CAUSES.index(cause) for cause in causes] for name, causes in GROUPS.items()}


@dataclass(frozen=True)
class Scene:
    """A moment of a mission. The viewer shows true values, and labels the robot's own estimates.

    Attributes:
        heading: Mission, difficulty and robot.
        mission: `OutAndBack`, `Survey` or `Patrol`.
        state: `ready`, `out`, `back` (of one that shuttles), `stopped`, `pit stop`, `returning`, `home`, `stranded` or
            `out of time`.
        over: Whether the mission is over.
        decision: Decisions taken.
        max_decisions: Decisions until the time limit.
        time_s: Time since the start, s.
        edges_m: Ends of the route's places, shape (places + 1,).
        elevation_m: Elevation above home there, m, shape (places + 1,).
        rough: Additional rolling resistance of the ground over the robot's file, as a share, shape (places,).
        interest: Interest of the ground, shape (places,).
        sensed: Stretches in which new ground was reached: from (m), to (m), share of the information that the sensing
            rate yields there; shape (stretches, 3).
        driven_m: Distance up to which the ground was driven, m.
        position_m: Distance from home along the route, m.
        furthest_m: The furthest so far, m.
        direction: 1 away from home, -1 towards it, also during a return that is not final.
        no_return_m: Point of no return by the robot's own model, m; None where there is none, see `PointOfNoReturn`.
        runs_out_m: Where the battery will be empty on the way home by the robot's own model; None if it gets home.
        laps_left: Laps that a mission that shuttles may add by the robot's own model, None for others.
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


def scene_of(batch: Batch, states: NDArray[np.void], limit: PointOfNoReturn, index: int = 0) -> Scene:
    """The present scene of one mission of a batch.

    Args:
        batch: The missions; they are only read.
        states: The mission's record after its reset and after every decision since, `MISSION_DTYPE`, shape (states,).
        limit: Made for the options of the batch.
        index: Index of the mission.
    """
    # As records with attributes, which the formulas of the environment take.
    m = batch.records.view(np.recarray)[index]
    s = batch.known.shared.view(np.recarray)[0]
    places = batch.routes["places"][index, : int(s.places)]
    robot = batch.known.robot.record()[0]
    if batch.hidden.record["own_robots"][0]:
        robot = batch.robots[index]
    home_j = float(home_cost(m, s))
    margin_j = float(m.metered * s.usable_j) - home_j
    direction = float(m.direction)
    if m.asked > 0:  # a return heads home before it is final
        direction = -1.0
    no_return_m = None
    runs_out_m = None
    laps_left = None
    if s.shuttles:
        laps_left = limit.laps_left(m, places, margin_j)
    elif not m.over and m.returning:
        runs_out_m = limit.runs_out_m(m, places, margin_j)
    elif not m.over:
        no_return_m = limit.no_return_m(m, places, margin_j)
    speed_mps = float(m.speed_mps)
    sensing_hz = float(m.sensing_hz)
    if m.over:
        speed_mps = 0.0
        sensing_hz = 0.0
    return Scene(
        heading=f"{batch.options.difficulty}, {batch.known.robot.name}",
        mission=batch.options.mission,
        state=_state(m),
        over=bool(m.over),
        decision=int(m.decisions),
        max_decisions=int(s.max_decisions),
        time_s=float(m.time_s),
        edges_m=np.linspace(0.0, len(places) * float(s.place_m), len(places) + 1),
        elevation_m=np.concatenate(([0.0], np.cumsum(places["sin_grade"] * float(s.place_m)))),
        rough=places["roughness"] * float(robot["surface_gain"]),
        interest=places["interest"].astype(np.float64),
        sensed=_sensed(states, float(s.saturation_per_m), float(s.min_speed_mps)),
        driven_m=float(m.mapped * s.place_m),
        position_m=float(m.position_m),
        furthest_m=float(m.furthest_m),
        direction=direction,
        no_return_m=no_return_m,
        runs_out_m=runs_out_m,
        laps_left=laps_left,
        full_j=float(s.usable_j),
        worn_j=max(float(s.usable_j - m.capacity_j), 0.0),
        left_j=float(m.energy_j),
        gauge_j=float(m.soc * s.usable_j),
        home_j=home_j,
        margin_j=margin_j,
        used_j={name: float(m.ledger_j[columns].sum()) for name, columns in _COLUMNS.items()},
        read_w=float(m.read_w),
        power_w=_power(states),
        speed_mps=speed_mps,
        max_speed_mps=float(s.max_speed_mps),
        sensing_hz=sensing_hz,
        max_sensing_hz=float(s.max_sensing_hz),
        memory=float(m.backlog / s.backlog_limit),
        on_board=float(m.backlog_information),
        delivered=float(m.delivered),
        lost=float(m.lost),
        sending=bool(np.diff(states["delivered"][-2:]).sum() > 0.0),
        score=float(m.score),
        good_score=float(s.score_scale),
        headwind_mps=float(direction * weather.headwind(m, m.here)),
        temperature_c=float(m.temperature_c),
    )


def _state(m: Any) -> str:
    for name, holds in (
        ("home", m.home),
        ("stranded", m.depleted),
        ("out of time", m.over),
        ("ready", m.decisions == 0),
        ("pit stop", m.dwell_s > 0.0),
        ("stopped", m.speed_mps == 0.0),
        ("returning", m.asked > 0),
        ("out", m.direction > 0.0),
    ):
        if holds:
            return name
    return "back"


def _sensed(states: NDArray[np.void], half_per_m: float, slowest_mps: float) -> NDArray[np.float64]:
    starts_m = states["furthest_m"][:-1]
    ends_m = states["furthest_m"][1:]
    reached = np.flatnonzero(ends_m > starts_m)
    # At the end of the route a decision ends standing.
    speeds_mps = np.maximum(states["speed_mps"][1:][reached], slowest_mps)
    samples_per_m = states["sensing_hz"][1:][reached] / speeds_mps
    shares = [information(1.0, 1.0, samples, 1.0, half_per_m) for samples in samples_per_m]
    return np.stack((starts_m[reached], ends_m[reached], np.array(shares)), axis=-1)


def _power(states: NDArray[np.void]) -> float:
    if len(states) < 2:
        return 0.0
    start = states[-2]
    end = states[-1]
    passed_s = float(end["time_s"] - start["time_s"])
    if passed_s <= 0.0:
        return 0.0
    return float(start["energy_j"] - end["energy_j"]) / passed_s
