"""One decision, compiled: driven place by place through the physics kernel, with the prediction of the robot's own
model."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs import docks, sensing
from homeward.envs.conditions import gauges, weather
from homeward.envs.state import RETURN, STOP
from homeward.physics import model
from homeward.physics.jit import inline
from homeward.physics.kernel import Conditions, advance, connect, demand


@inline
def decide(
    m: Any,
    p: Any,
    route: Any,
    nominal: Any,
    shared: Any,
    speed_mps: float,
    sensing_hz: float,
    mode: int,
) -> None:
    """Carry out one decision, place by place, until its time is over, the battery is empty or the robot is home.

    A robot that stops drives on to a dock that it reaches within the decision, and stands there.
    """
    outwards = m.direction
    heads_home = mode == RETURN and not m.returning
    if heads_home:
        m.direction = -1.0
        m.asked += 1
        if m.asked >= shared.return_decisions:
            m.returning, m.dwell_s = True, 0.0
            m.home = m.position_m <= 0.0
    elif not m.returning:
        m.asked = 0
    m.decisions += 1
    m.sensing_hz = sensing_hz
    # The change of speed is spread over the decision.
    accel = (speed_mps - m.speed_mps) * shared.per_decision
    left_s = shared.decision_s
    while left_s > 0.0 and not m.home and not m.depleted:
        speed, dt_s, halt_m, arriving, crossing = 0.0, left_s, 0.0, False, False
        dock_m = docks.next_dock_m(m, shared) if mode == STOP else np.inf
        to_dock_m = m.direction * (dock_m - m.position_m)
        docks_now = 0.0 < to_dock_m <= speed_mps * left_s
        if m.dwell_s > 0.0:
            dt_s = min(left_s, m.dwell_s)
        elif docks_now or (mode != STOP and _may_drive(m, shared, heads_home and not m.returning)):
            halt_m = (m.place + (m.direction > 0.0)) * shared.place_m
            ahead_m = m.direction * (halt_m - m.position_m)
            if ahead_m <= 0.0:
                cross(m, p, route, nominal, shared)
                continue
            crossing = not (docks_now and to_dock_m < ahead_m)
            if not crossing:
                halt_m, ahead_m = dock_m, to_dock_m
            speed = speed_mps
            arriving = ahead_m <= speed * left_s
            if arriving:
                dt_s = ahead_m / speed
        x = _conditions(m, m.here, speed, sensing_hz, accel, weather.headwind(m, m.here), m.direction)
        charger_w = docks.charger_w(m, shared) if speed == 0.0 else 0.0
        passed_s = advance(p, m, x, connect(p, m, x, charger_w, dt_s))
        m.charger_w = 0.0
        if charger_w > 0.0:
            gauges.expect_rise(m)
        left_s -= passed_s
        m.dwell_s = max(m.dwell_s - passed_s, 0.0)
        arriving = arriving and not m.depleted
        m.position_m = halt_m if arriving else m.position_m + m.direction * speed * passed_s
        new_m = max(m.position_m - m.furthest_m, 0.0)
        m.furthest_m = max(m.furthest_m, m.position_m)
        _account(m, nominal, shared, x, passed_s, new_m)
        if arriving and crossing:
            cross(m, p, route, nominal, shared)
    if heads_home and not m.returning and m.direction < 0.0:
        m.direction = outwards
        # A robot whose battery runs empty at home, before its return is final, is home.
        m.home = m.depleted and m.position_m <= 0.0 and m.furthest_m > 0.0
        m.depleted = m.depleted and not m.home


@inline
def _may_drive(m: Any, shared: Any, heads_home_for_now: bool) -> Any:
    """Whether the robot may drive on: not beyond the end of the route, nor outwards while a return is chosen."""
    if heads_home_for_now:
        return m.direction < 0.0 and m.position_m > 0.0
    return m.direction < 0.0 or m.position_m < shared.length_m


@inline
def cross(m: Any, p: Any, route: Any, nominal: Any, shared: Any) -> None:
    """Cross the border ahead: into the next place, or to an end of the route."""
    ahead = m.place + (1 if m.direction > 0.0 else -1)
    if ahead < 0 or ahead == shared.places:
        _arrive(m, shared)
        return
    m.place = ahead
    if m.place == m.mapped:
        home_cost_j = m.here.home_cost_j + m.here.home_j_per_m * shared.place_m
        true_home_cost_j = m.here.true_home_cost_j + m.here.true_home_j_per_m * shared.place_m
        map_place(m, p, route.places[ahead], nominal, shared, home_cost_j, true_home_cost_j)
    m.here = route.places[ahead]


@inline
def _arrive(m: Any, shared: Any) -> None:
    """Reach an end of the route: home ends a mission that returns, and one that shuttles turns after a pit stop."""
    if shared.shuttles and (m.position_m > 0.0 or m.legs % 2.0 == 1.0):
        m.legs += 1.0
    if m.returning:
        m.home = m.position_m <= 0.0
    elif shared.shuttles:
        m.dwell_s = shared.pit_stop_s
        m.direction = -m.direction


@inline
def map_place(
    m: Any, p: Any, place: Any, believed: Any, shared: Any, home_cost_j: float, true_home_cost_j: float
) -> None:
    """Predict the energy of a place at the first visit, by the robot's own model and the grade as read."""
    place.home_cost_j, place.true_home_cost_j = home_cost_j, true_home_cost_j
    cruise = shared.cruise_mps
    headwind = weather.headwind(m, place) if shared.route_is_known else 0.0
    # The model's powers are computed in the mission's own record, with cold windings, long after a start, at time 0.
    state_before = m.time_s, m.step_s, m.speed_mps, m.winding_k, m.start_left, m.traction_n, m.drive_w, m.power_w
    m.time_s, m.step_s, m.speed_mps, m.winding_k, m.start_left = 0.0, shared.decision_s, cruise, 0.0, 0.0
    true_home_w = demand(p, m, _conditions(m, place, cruise, 0.0, 0.0, weather.headwind(m, place), -1.0))
    true_sine, true_j = place.sin_grade, m.energy_j
    # The robot's model knows the charge, and so the voltage, as it is read.
    place.sin_grade, m.energy_j = place.sine_read, m.soc * m.capacity_j
    standing_w = demand(believed, m, _conditions(m, place, 0.0, 0.0, 0.0, headwind, 1.0))
    out_w = demand(believed, m, _conditions(m, place, cruise, 0.0, 0.0, headwind, 1.0))
    home_w = demand(believed, m, _conditions(m, place, cruise, 0.0, 0.0, headwind, -1.0))
    place.sin_grade, m.energy_j = true_sine, true_j
    m.time_s, m.step_s, m.speed_mps, m.winding_k, m.start_left, m.traction_n, m.drive_w, m.power_w = state_before
    place.standing_w = standing_w
    place.out_j_per_m = (out_w - standing_w) / cruise
    place.back_j_per_m = (home_w - standing_w) / cruise
    place.home_j_per_m, place.true_home_j_per_m = home_w / cruise, true_home_w / cruise
    m.mapped += 1


@inline
def _account(m: Any, nominal: Any, shared: Any, x: Any, passed_s: float, new_m: float) -> None:
    """Add the energy that the robot's own model predicts for a stretch, and the samples taken and sent on it."""
    here = m.here
    drive_j_per_m = here.out_j_per_m if x.direction > 0.0 else here.back_j_per_m
    drive_j_per_m += shared.drag_j_per_m * (x.speed_mps * x.speed_mps - shared.cruise_mps * shared.cruise_mps)
    sensing_w = model.ancillary_power(nominal, x.sensing_hz) - model.ancillary_power(nominal, 0.0)
    m.modelled_j += (max(drive_j_per_m, 0.0) * x.speed_mps + here.standing_w + sensing_w) * passed_s
    if shared.senses:
        sensing.sense(m, here, shared, x.sensing_hz * passed_s, x.speed_mps * passed_s, new_m)
        sensing.transmit(m, shared, x.speed_mps > 0.0, passed_s)


@inline
def _conditions(
    m: Any, place: Any, speed_mps: float, sensing_hz: float, accel_mps2: float, headwind_mps: float, ahead: float
) -> Any:
    """Conditions at a place; `ahead` is 1 away from home and -1 towards it, the headwind that of the way out."""
    sine, roughness = ahead * place.sin_grade, float(place.roughness)
    return Conditions(
        speed_mps,
        sensing_hz,
        accel_mps2,
        sine,
        np.sqrt(1.0 - sine * sine),
        ahead * place.curvature_per_m * speed_mps,
        roughness,
        ahead * headwind_mps,
        m.temperature_c,
        m.position_m,
        ahead,
    )
