"""One decision, compiled: driven place by place through the physics kernel, with the prediction of
the robot's own model."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs import docks, sensing
from homeward.envs.conditions import gauges, weather
from homeward.envs.state import RETURN, STOP
from homeward.physics import battery, model
from homeward.physics.jit import inline
from homeward.physics.kernel import Conditions, advance, connect, demand
from homeward.physics.robot import HAS_CUTOFF


@inline
def decide(
    mission: Any,
    robot: Any,
    route: Any,
    nominal: Any,
    shared: Any,
    speed_mps: float,
    sensing_hz: float,
    mode: int,
) -> None:
    """Carry out one decision, place by place, until its time is over, the battery has ended or the
    robot is home.

    A robot that stops drives on to a dock that it reaches within the decision, and stands there.
    """
    outwards = mission.direction
    heads_home = mode == RETURN and not mission.returning
    _count_asked(mission, shared, heads_home)
    mission.decisions += 1
    mission.sensing_hz = sensing_hz
    # The change of speed is spread over the decision.
    accel_mps2 = (speed_mps - mission.speed_mps) * shared.per_decision
    left_s = shared.decision_s
    while left_s > 0.0 and not mission.home and not mission.depleted:
        # Unless it drives, it stands until the decision is over.
        driven_mps = 0.0
        dt_s = left_s
        halt_m = 0.0
        arriving = False
        crossing = False
        dock_m = np.inf
        if mode == STOP:
            dock_m = docks.next_dock_m(mission, shared)
        to_dock_m = mission.direction * (dock_m - mission.position_m)
        docks_now = 0.0 < to_dock_m <= speed_mps * left_s
        if mission.dwell_s > 0.0:
            dt_s = min(left_s, mission.dwell_s)
        elif docks_now or (
            mode != STOP and _may_drive(mission, shared, heads_home and not mission.returning)
        ):
            halt_m = (mission.place + (mission.direction > 0.0)) * shared.place_m
            ahead_m = mission.direction * (halt_m - mission.position_m)
            if ahead_m <= 0.0:
                cross(mission, robot, route, nominal, shared)
                continue
            crossing = not (docks_now and to_dock_m < ahead_m)
            if not crossing:
                halt_m = dock_m
                ahead_m = to_dock_m
            driven_mps = speed_mps
            arriving = ahead_m <= driven_mps * left_s
            if arriving:
                dt_s = ahead_m / driven_mps
        headwind_mps = weather.headwind(mission, mission.here)
        conditions = _conditions(
            mission,
            mission.here,
            driven_mps,
            sensing_hz,
            accel_mps2,
            headwind_mps,
            mission.direction,
        )
        charger_w = 0.0
        if driven_mps == 0.0:
            charger_w = docks.charger_w(mission, shared)
        connected = connect(robot, mission, conditions, charger_w, dt_s)
        passed_s = advance(robot, mission, conditions, connected)
        mission.charger_w = 0.0
        if charger_w > 0.0:
            gauges.expect_rise(mission)
        left_s -= passed_s
        mission.dwell_s = max(mission.dwell_s - passed_s, 0.0)
        arriving = arriving and not mission.depleted
        mission.position_m = mission.position_m + mission.direction * driven_mps * passed_s
        if arriving:
            mission.position_m = halt_m  # without the rounding of the way
        new_m = max(mission.position_m - mission.furthest_m, 0.0)
        mission.furthest_m = max(mission.furthest_m, mission.position_m)
        _account(mission, nominal, shared, conditions, passed_s, new_m)
        if arriving and crossing:
            cross(mission, robot, route, nominal, shared)
    _take_back(mission, heads_home, outwards)


@inline
def _count_asked(mission: Any, shared: Any, heads_home: bool) -> None:
    """Turn a robot that is asked to return; the return is final when it was asked often enough in a
    row."""
    if heads_home:
        mission.direction = -1.0
        mission.asked += 1
        if mission.asked >= shared.return_decisions:
            mission.returning = True
            mission.dwell_s = 0.0
            mission.home = mission.position_m <= 0.0
    elif not mission.returning:
        mission.asked = 0


@inline
def _take_back(mission: Any, heads_home: bool, outwards: float) -> None:
    """Let a robot that was asked to return, but not yet finally, face where it did."""
    if heads_home and not mission.returning and mission.direction < 0.0:
        mission.direction = outwards
        # A robot whose battery runs empty at home, before its return is final, is home.
        mission.home = mission.depleted and mission.position_m <= 0.0 and mission.furthest_m > 0.0
        mission.depleted = mission.depleted and not mission.home


@inline
def _may_drive(mission: Any, shared: Any, heads_home_for_now: bool) -> Any:
    """Whether the robot may drive on: not beyond the end of the route, nor outwards while a return
    is chosen."""
    if heads_home_for_now:
        return mission.direction < 0.0 and mission.position_m > 0.0
    return mission.direction < 0.0 or mission.position_m < shared.length_m


@inline
def cross(mission: Any, robot: Any, route: Any, nominal: Any, shared: Any) -> None:
    """Cross the border ahead: into the next place, or to an end of the route."""
    ahead = mission.place + (1 if mission.direction > 0.0 else -1)
    if ahead < 0 or ahead == shared.places:
        _arrive(mission, shared)
        return
    mission.place = ahead
    if mission.place == mission.mapped:
        home_cost_j = mission.here.home_cost_j + mission.here.home_j_per_m * shared.place_m
        true_home_cost_j = (
            mission.here.true_home_cost_j + mission.here.true_home_j_per_m * shared.place_m
        )
        map_place(
            mission, robot, route.places[ahead], nominal, shared, home_cost_j, true_home_cost_j
        )
    mission.here = route.places[ahead]


@inline
def _arrive(mission: Any, shared: Any) -> None:
    """Reach an end of the route: home ends a mission that returns, and one that shuttles turns
    after a pit stop."""
    if shared.shuttles and (mission.position_m > 0.0 or mission.legs % 2.0 == 1.0):
        mission.legs += 1.0
    if mission.returning:
        mission.home = mission.position_m <= 0.0
    elif shared.shuttles:
        mission.dwell_s = shared.pit_stop_s
        mission.direction = -mission.direction


@inline
def map_place(
    mission: Any,
    robot: Any,
    place: Any,
    believed: Any,
    shared: Any,
    home_cost_j: float,
    true_home_cost_j: float,
) -> None:
    """Predict the energy of a place at the first visit, by the robot's own model and the grade as
    read.

    On its way home through the place a battery with a cut-off must hold what stays below it at this
    load.
    """
    cruise_mps = shared.cruise_mps
    true_headwind_mps = weather.headwind(mission, place)
    headwind_mps = 0.0
    if shared.route_is_known:
        headwind_mps = true_headwind_mps

    # The model's powers are computed in the mission's own record, with cold windings, long after a
    # start, at time 0.
    state_before = (
        mission.time_s,
        mission.step_s,
        mission.speed_mps,
        mission.winding_k,
        mission.start_left,
        mission.traction_n,
        mission.drive_w,
        mission.power_w,
        mission.terminal_w,
    )
    true_sine = place.sin_grade
    true_j = mission.energy_j
    mission.time_s = 0.0
    mission.step_s = shared.decision_s
    mission.speed_mps = cruise_mps
    mission.winding_k = 0.0
    mission.start_left = 0.0
    true_home_w = demand(
        robot, mission, _conditions(mission, place, cruise_mps, 0.0, 0.0, true_headwind_mps, -1.0)
    )
    if robot.effects & HAS_CUTOFF:
        true_share_kept = battery.share_below_cutoff(robot, mission.terminal_w)
        true_home_cost_j = max(true_home_cost_j, mission.capacity_j * true_share_kept)
    # The robot's model knows the charge, and so the voltage, as it is read, and the slope likewise.
    place.sin_grade = place.sine_read
    mission.energy_j = mission.soc * mission.capacity_j
    standing_w = demand(
        believed, mission, _conditions(mission, place, 0.0, 0.0, 0.0, headwind_mps, 1.0)
    )
    out_w = demand(
        believed, mission, _conditions(mission, place, cruise_mps, 0.0, 0.0, headwind_mps, 1.0)
    )
    home_w = demand(
        believed, mission, _conditions(mission, place, cruise_mps, 0.0, 0.0, headwind_mps, -1.0)
    )
    if believed.effects & HAS_CUTOFF:
        share_kept = battery.share_below_cutoff(believed, mission.terminal_w)
        home_cost_j = max(home_cost_j, shared.usable_j * share_kept)
    place.sin_grade = true_sine
    mission.energy_j = true_j
    (
        mission.time_s,
        mission.step_s,
        mission.speed_mps,
        mission.winding_k,
        mission.start_left,
        mission.traction_n,
        mission.drive_w,
        mission.power_w,
        mission.terminal_w,
    ) = state_before

    place.home_cost_j = home_cost_j
    place.true_home_cost_j = true_home_cost_j
    place.standing_w = standing_w
    place.out_j_per_m = (out_w - standing_w) / cruise_mps
    place.back_j_per_m = (home_w - standing_w) / cruise_mps
    place.home_j_per_m = home_w / cruise_mps
    place.true_home_j_per_m = true_home_w / cruise_mps
    mission.mapped += 1


@inline
def _account(
    mission: Any, nominal: Any, shared: Any, conditions: Any, passed_s: float, new_m: float
) -> None:
    """Add the energy that the robot's own model predicts for a stretch, and the samples taken and
    sent on it."""
    place = mission.here
    drive_j_per_m = place.back_j_per_m
    if conditions.direction > 0.0:
        drive_j_per_m = place.out_j_per_m
    drive_j_per_m += shared.drag_j_per_m * (
        conditions.speed_mps * conditions.speed_mps - shared.cruise_mps * shared.cruise_mps
    )
    sensing_w = model.ancillary_power(nominal, conditions.sensing_hz) - model.ancillary_power(
        nominal, 0.0
    )
    mission.modelled_j += (
        max(drive_j_per_m, 0.0) * conditions.speed_mps + place.standing_w + sensing_w
    ) * passed_s
    if shared.senses:
        sensing.sense(
            mission,
            place,
            shared,
            conditions.sensing_hz * passed_s,
            conditions.speed_mps * passed_s,
            new_m,
        )
        sensing.transmit(mission, shared, conditions.speed_mps > 0.0, passed_s)


@inline
def _conditions(
    mission: Any,
    place: Any,
    speed_mps: float,
    sensing_hz: float,
    accel_mps2: float,
    headwind_mps: float,
    ahead: float,
) -> Any:
    """Conditions at a place; `ahead` is 1 away from home and -1 towards it, the headwind that of
    the way out."""
    sine = ahead * place.sin_grade
    return Conditions(
        speed_mps=speed_mps,
        sensing_hz=sensing_hz,
        accel_mps2=accel_mps2,
        sin_grade=sine,
        cos_grade=np.sqrt(1.0 - sine * sine),
        yaw_rate_radps=ahead * place.curvature_per_m * speed_mps,
        roughness=float(place.roughness),
        headwind_mps=ahead * headwind_mps,
        temperature_c=mission.temperature_c,
        base_distance_m=mission.position_m,
        direction=ahead,
    )
