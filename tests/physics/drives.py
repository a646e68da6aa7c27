"""Robots and drives that hypothesis draws, and the one compiled loop that drives them in the tests
of the physics."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from homeward import Robot
from homeward.physics import EFFECTS
from homeward.physics.jit import compiled
from homeward.physics.kernel import Conditions, advance, full_charge

Array = NDArray[np.float64]

PLAIN = Robot(
    name="plain",
    mass_kg=10.0,
    rolling_resistance=0.1,
    drag_ns2_per_m2=0.5,
    rated_energy_j=1e5,
    nominal_voltage_v=10.0,
    motor_loss=0.5,
    friction_loss=0.0,
    min_speed_mps=0.1,
    max_speed_mps=4.0,
    sensing_idle_w=0.5,
    sensing_j_per_sample=0.01,
    max_sensing_hz=100.0,
    communication_w=0.25,
    controller_w=0.75,
    computer_w=2.0,
    computer_j_per_sample=0.02,
    track_m=0.5,
)
"""Round numbers: Gamma is one half."""

LINEAR = ((0.0, 8.0), (1.0, 12.0))
"""Another, whose square is 64 V^2 + 80 V^2 times the share of the energy: by hand, V = 8 + 4 q at a
share q of charge, of which the share 0.8 q + 0.2 q^2 is the energy."""

FALLING = ((0.0, 8.0), (0.1, 9.5), (0.4, 10.0), (1.0, 11.5))
"""Open-circuit voltage of a battery that falls as it empties."""


def cut_off(load_w: float, ohm: float = 0.5, cutoff_v: float = 9.0) -> Robot:
    """`PLAIN` on a battery `LINEAR` with a cut-off, which draws a load while it stands: 1.5 W of the
    file, and the rest on standby."""
    effects = {"standby": {"power_w": load_w - 1.5}, "internal_resistance": {"ohm": ohm}}
    return dataclasses.replace(PLAIN, open_circuit_v=LINEAR, cutoff_v=cutoff_v, effects=effects)


STEADY = Conditions(
    speed_mps=2.0,
    sensing_hz=50.0,
    accel_mps2=0.0,
    sin_grade=0.0,
    cos_grade=1.0,
    yaw_rate_radps=0.0,
    roughness=0.0,
    headwind_mps=0.0,
    temperature_c=20.0,
    base_distance_m=0.0,
    direction=1.0,
)


def quantities(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers whose order of magnitude is drawn evenly."""
    return (
        st.floats(math.log(low), math.log(high))
        .map(math.exp)
        .map(lambda value: min(max(value, low), high))
    )


def not_negative(low: float, high: float) -> st.SearchStrategy[float]:
    return st.just(0.0) | quantities(low, high)


@st.composite
def effects(draw: st.DrawFn, without: Sequence[str] = ()) -> dict[str, dict[str, float]]:
    """Any subset of the effects, their parameters within bounds."""
    chosen = draw(
        st.sets(st.sampled_from([effect for effect in EFFECTS if effect.id not in without]))
    )
    return {
        effect.id: {one.name: draw(st.floats(one.low, one.high)) for one in effect.parameters}
        for effect in sorted(chosen, key=lambda effect: effect.id)
    }


@st.composite
def robots(draw: st.DrawFn, with_effects: bool = True, without: Sequence[str] = ()) -> Robot:
    """Ground robots from grams to tonnes, as lossy as the paper's and worse, with any effects
    on."""
    curve: tuple[tuple[float, float], ...] = draw(st.just(()) | st.just(FALLING))
    cutoff_v = 0.0
    if curve and with_effects:
        cutoff_v = draw(st.just(0.0) | st.just(9.0))
    slow, fast = sorted((draw(quantities(0.01, 10.0)), draw(quantities(0.01, 10.0))))
    return Robot(
        name="drawn",
        mass_kg=draw(quantities(0.05, 5000.0)),
        rolling_resistance=draw(quantities(1e-3, 1.0)),
        drag_ns2_per_m2=draw(not_negative(1e-3, 10.0)),
        rated_energy_j=draw(quantities(1e2, 1e9)),
        nominal_voltage_v=draw(quantities(1.0, 1000.0)),
        motor_loss=draw(st.floats(0.0, 0.95)),
        friction_loss=draw(st.floats(0.0, 0.95)),
        min_speed_mps=slow,
        max_speed_mps=fast,
        sensing_idle_w=draw(not_negative(1e-3, 100.0)),
        sensing_j_per_sample=draw(not_negative(1e-6, 1.0)),
        max_sensing_hz=draw(quantities(1.0, 1000.0)),
        communication_w=draw(not_negative(1e-3, 100.0)),
        controller_w=draw(quantities(1e-2, 100.0)),
        computer_w=draw(not_negative(1e-3, 100.0)),
        computer_j_per_sample=draw(not_negative(1e-6, 1.0)),
        track_m=draw(quantities(0.05, 5.0)),
        open_circuit_v=curve,
        cutoff_v=cutoff_v,
        effects=draw(effects(without)) if with_effects else {},
    )


@st.composite
def conditions(draw: st.DrawFn, robot: Robot, standing: bool = True) -> Conditions:
    grade_rad = draw(st.floats(-1.2, 1.2))
    speed = st.floats(robot.min_speed_mps, robot.max_speed_mps)
    return Conditions(
        speed_mps=draw(st.just(0.0) | speed) if standing else draw(speed),
        sensing_hz=draw(not_negative(1e-3, robot.max_sensing_hz)),
        accel_mps2=draw(st.floats(-2.0, 2.0)),
        sin_grade=math.sin(grade_rad),
        cos_grade=math.cos(grade_rad),
        yaw_rate_radps=draw(st.floats(-2.0, 2.0)),
        roughness=draw(st.floats(0.0, 3.0)),
        headwind_mps=draw(st.floats(-20.0, 20.0)),
        temperature_c=draw(st.floats(-30.0, 45.0)),
        base_distance_m=draw(st.floats(0.0, 1e4)),
        direction=draw(st.sampled_from([1.0, -1.0])),
    )


def with_effect(robot: Robot, effect_id: str, **parameters: float) -> Robot:
    return dataclasses.replace(robot, effects={effect_id: parameters})


def drive(
    robot: Robot,
    steps: Sequence[Conditions],
    dt_s: float | Sequence[float],
    energy_j: float | None = None,
    **state: float,
) -> Any:
    """State, of shape (), after driving the steps in order, or after as many as the battery
    lasts."""
    states = full_charge(robot, energy_j)
    for name, value in state.items():
        states[name] = value
    _drive(
        robot.record(),
        states,
        np.array(steps, dtype=np.float64),
        np.broadcast_to(dt_s, len(steps)).astype(float),
    )
    return states[0]


@compiled
def _drive(robots: Any, states: Any, steps: Any, dt_s: Any) -> None:
    p, s = robots[0], states[0]
    for i in range(len(steps)):
        c = steps[i]
        x = Conditions(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10])
        advance(p, s, x, dt_s[i])
        if s.depleted:
            break
