"""The step: how long a robot drives or stands on its battery, and where the energy goes.

One compiled step over one robot record and one state record serves the environments, the replay of recordings and the
range. Within a step the conditions are constant, so that the power is too and the moment of depletion is solved for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.physics import model
from homeward.physics.effects import EFFECTS, Kind, motor_heating
from homeward.physics.jit import inline
from homeward.physics.robot import Robot

BASE_CAUSES = ("sensing", "communication", "controller", "computer", "rolling", "drag", "grade", "braking")
CAUSES = BASE_CAUSES + tuple(effect.id for effect in EFFECTS)
"""Columns of the energy ledger. `grade` is negative downhill, and `braking` is what the robot then cannot take back."""

SENSING, COMMUNICATION, CONTROLLER, COMPUTER, ROLLING, DRAG, GRADE, BRAKING = range(len(BASE_CAUSES))
_BASE, _EFFECTS = len(BASE_CAUSES), len(EFFECTS)

STATE_FIELDS = (
    ("energy_j", np.float64),  # left in the battery
    ("capacity_j", np.float64),  # the most the battery can hold
    ("time_s", np.float64),
    ("distance_m", np.float64),  # driven, in any direction
    ("speed_mps", np.float64),  # in the step before
    ("winding_k", np.float64),  # motor winding above ambient
    ("step_s", np.float64),  # length of the step under way
    ("traction_n", np.float64),  # force at the wheels in the last step
    ("drive_w", np.float64),  # power into the drive in the last step
    ("power_w", np.float64),  # power out of the battery in the last step
    ("depleted", np.bool_),
)
"""Fields of the state record that the step reads and writes; an environment's record adds its own."""


class Conditions(NamedTuple):
    """What the robot does and meets during one step. Signs are along the direction of travel.

    `direction` is 1 on the way out and -1 on the way home.
    """

    speed_mps: float
    sensing_hz: float
    accel_mps2: float
    sin_grade: float
    cos_grade: float
    yaw_rate_radps: float
    roughness: float
    headwind_mps: float
    temperature_c: float
    base_distance_m: float
    direction: float


def _compose(kind: Kind, *, cumulative: bool) -> Callable[..., float]:
    """Compose all effects of a kind into one function: what those that are switched on add to a load.

    It notes each one's own power in its column of `parts`: its contribution times `watts_per_unit`. With `cumulative`
    each effect sees the load with all before it added, else each sees the load alone.
    """

    @inline
    def nothing(p: Any, s: Any, x: Any, parts: Any, load: float, watts_per_unit: float) -> float:
        return 0.0

    total = nothing
    for index, effect in enumerate(EFFECTS):
        if effect.kind == kind:
            total = _append(total, effect.function, index, cumulative)
    return total


def _append(before: Callable[..., float], effect: Callable[..., float], index: int, cumulative: bool) -> Any:
    mask, column = np.uint64(1 << index), _BASE + index

    @inline
    def total(p: Any, s: Any, x: Any, parts: Any, load: float, watts_per_unit: float) -> float:
        added = before(p, s, x, parts, load, watts_per_unit)
        if p.effects & mask:
            part = effect(p, s, x, load + added if cumulative else load)
            parts[column] = part * watts_per_unit
            added += part
        return added

    return total


_extra_force = _compose("force", cumulative=True)
_extra_drive = _compose("drive", cumulative=False)
_extra_ancillary = _compose("ancillary", cumulative=True)
_extra_battery = _compose("battery", cumulative=True)


@inline
def demand(p: Any, s: Any, x: Any, parts: Any) -> float:
    """Power that the battery delivers under constant conditions, W.

    Args:
        p: Robot record.
        s: State record; `traction_n`, `drive_w` and `power_w` are written.
        x: `Conditions`.
        parts: Row of shape (len(CAUSES),); the power of each effect that is on is written to its column, W.
    """
    moving = x.speed_mps > 0.0
    force_n = 0.0
    if moving:
        force_n = (
            model.rolling_force(p, x.cos_grade) + model.drag_force(p, x.speed_mps) + model.grade_force(p, x.sin_grade)
        )
    ancillary_w = model.ancillary_power(p, x.sensing_hz)
    if p.effects != 0:
        force_n += _extra_force(p, s, x, parts, force_n, x.speed_mps / model.traction_efficiency(p))
        ancillary_w += _extra_ancillary(p, s, x, parts, ancillary_w, 1.0)
    drive_w = model.drive_power(p, force_n, x.speed_mps)
    if p.effects != 0:
        drive_w += _extra_drive(p, s, x, parts, force_n, 1.0)
    power_w = ancillary_w + drive_w
    if p.effects != 0:
        power_w += _extra_battery(p, s, x, parts, power_w, 1.0)
    s.traction_n, s.drive_w, s.power_w = force_n, drive_w, power_w
    return power_w


@inline
def advance(p: Any, s: Any, x: Any, dt_s: float, ledger_j: Any, parts: Any) -> float:
    """Let time pass under constant conditions, until `dt_s` is over or the battery is empty.

    Args:
        p: Robot record.
        s: State record (`STATE_FIELDS`), updated; `depleted` is set, and stays set, when the battery runs out.
        x: `Conditions`.
        dt_s: Time to pass, s, above zero.
        ledger_j: Row of shape (len(CAUSES),): energy by cause, J, added to. It sums to what the battery lost.
        parts: Row of shape (len(CAUSES),) to work in.

    Returns:
        Time that passed, s.
    """
    s.step_s = dt_s
    power_w = demand(p, s, x, parts)
    passed_s = dt_s
    spent_j = power_w * dt_s
    if spent_j >= s.energy_j:
        s.depleted = True
        passed_s = s.energy_j / power_w if power_w > 0.0 else 0.0
        spent_j = s.energy_j
    elif s.energy_j - spent_j > s.capacity_j:  # a full battery takes nothing back: the brakes do
        ledger_j[BRAKING] += s.energy_j - spent_j - s.capacity_j
        spent_j = s.energy_j - s.capacity_j
    s.energy_j -= spent_j
    _book(p, s, x, passed_s, ledger_j, parts)
    s.time_s += passed_s
    s.distance_m += x.speed_mps * passed_s
    s.speed_mps = x.speed_mps
    return passed_s


@inline
def _book(p: Any, s: Any, x: Any, passed_s: float, ledger_j: Any, parts: Any) -> None:
    """Add the energy of a step to the ledger, and let the effects remember."""
    ledger_j[SENSING] += model.sensing_power(p, x.sensing_hz) * passed_s
    ledger_j[COMMUNICATION] += p.communication_w * passed_s
    ledger_j[CONTROLLER] += p.controller_w * passed_s
    ledger_j[COMPUTER] += model.computer_power(p, x.sensing_hz) * passed_s
    if x.speed_mps > 0.0:
        travel = x.speed_mps * passed_s / model.traction_efficiency(p)  # J of the battery per N at the wheels
        ledger_j[ROLLING] += model.rolling_force(p, x.cos_grade) * travel
        ledger_j[DRAG] += model.drag_force(p, x.speed_mps) * travel
        ledger_j[GRADE] += model.grade_force(p, x.sin_grade) * travel
        if s.traction_n < 0.0:
            ledger_j[BRAKING] -= s.traction_n * travel
    if p.effects != 0:
        for index in range(_EFFECTS):
            if (p.effects >> np.uint64(index)) & np.uint64(1):
                ledger_j[_BASE + index] += parts[_BASE + index] * passed_s
        motor_heating.remember(p, s, x, passed_s)


ROBOT_STATE_DTYPE = np.dtype(list(STATE_FIELDS), align=True)


def full_charge(robot: Robot, energy_j: float | None = None) -> NDArray[np.void]:
    """State of a robot before its first step, shape (1,): battery full, or with `energy_j` in it."""
    state = np.zeros(1, ROBOT_STATE_DTYPE)
    state["energy_j"] = robot.usable_energy_j if energy_j is None else energy_j
    state["capacity_j"] = np.maximum(state["energy_j"], robot.usable_energy_j)
    return state
