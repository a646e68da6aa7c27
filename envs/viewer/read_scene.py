"""The scene of a mission, read from its records."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.batch import Batch
from homeward.envs.conditions import weather
from homeward.envs.features import home_cost
from homeward.envs.sensing import information
from homeward.envs.viewer.point_of_no_return import PointOfNoReturn
from homeward.envs.viewer.scene import Scene
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
    "battery losses": ("internal_resistance", "rate_capacity", "ageing", "cold_battery", "below_cutoff"),
}  # fmt: skip
"""Causes of the energy ledger under the names that the viewer shows; each cause is in one group."""

_COLUMNS = {name: [CAUSES.index(cause) for cause in causes] for name, causes in GROUPS.items()}


def scene_of(
    batch: Batch, states: NDArray[np.void], limit: PointOfNoReturn, index: int = 0
) -> Scene:
    """The present scene of one mission of a batch.

    Args:
        batch: The missions; they are only read.
        states: The mission's record after its reset and after every decision since,
            `MISSION_DTYPE`, shape (states,).
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
