"""The step: how long a robot drives or stands on its battery, and the energy by cause.

One compiled step over one robot record and one state record serves the environments, the replay of
recordings and the range. Within a step the conditions are constant. So the power is constant too,
and the moment of depletion is solved for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.physics import battery, model
from homeward.physics.effects import EFFECTS, Kind, breakaway, intermittent_load, motor_heating
from homeward.physics.jit import inline
from homeward.physics.robot import HAS_CUTOFF, Robot

BASE_CAUSES = (
    "sensing", "communication", "controller", "computer", "rolling", "drag", "grade", "braking", "charger",
    "below_cutoff",
)  # fmt: skip
CAUSES = BASE_CAUSES + tuple(effect.id for effect in EFFECTS)
"""Columns of the energy ledger. Forces are booked while the drive works, with `grade` negative
downhill. Where the slope drives the robot alone, no force is booked. `braking` is regenerated
energy that a full battery cannot store. `charger` is negative: what a charger supplied, of which
the battery stores what the other causes leave. `below_cutoff` is the energy that stays in a battery
whose voltage under load has fallen to its cut-off: nobody gets it, and none counts as left."""

(
    SENSING,
    COMMUNICATION,
    CONTROLLER,
    COMPUTER,
    ROLLING,
    DRAG,
    GRADE,
    BRAKING,
    CHARGER,
    BELOW_CUTOFF,
) = range(len(BASE_CAUSES))
_BASE = len(BASE_CAUSES)
_EFFECTS = len(EFFECTS)
_FORCES = len([effect for effect in EFFECTS if effect.kind == "force"])
_INTERMITTENT = np.uint64(1 << [effect.id for effect in EFFECTS].index("intermittent_load"))
_GUESSES = 20  # of the moment of depletion; chosen, as are the next two: halvings reach rounding
_HALVINGS = 60
_ROUNDING = 1e-14
_FULL = 1e-12
"""Share of the capacity within which a battery counts as full. Chosen: above rounding, and no
energy."""

STATE_FIELDS = (
    ("energy_j", np.float64),  # left in the battery
    ("capacity_j", np.float64),  # the most the battery can hold
    ("time_s", np.float64),
    ("distance_m", np.float64),  # driven, in any direction
    ("speed_mps", np.float64),  # in the step before
    ("winding_k", np.float64),  # motor winding above ambient
    # share of its difference from the steady temperature that a step leaves
    ("winding_fade", np.float64),
    ("start_left", np.float64),  # share of the energy of the last start that is still to be spent
    ("step_s", np.float64),  # length of the step under way
    ("traction_n", np.float64),  # force at the wheels in the last step
    ("drive_w", np.float64),  # mean power into the drive in the last step
    ("power_w", np.float64),  # mean power out of the battery in the last step
    # the same at its terminals, without what is lost inside; written if any effect is on
    ("terminal_w", np.float64),
    # power of the charger that the robot is connected to in the step under way
    ("charger_w", np.float64),
    ("depleted", np.bool_),
    ("endless", np.bool_),  # the battery does not run out, and is never full: that of a recording
    ("ledger_j", np.float64, (len(CAUSES),)),  # energy that left the battery, by cause
    # power of each effect that is on, in the step under way
    ("parts_w", np.float64, (len(CAUSES),)),
)
"""Fields of the state record that the step reads and writes; an environment's record adds its
own."""


class Conditions(NamedTuple):
    """Action of the robot and conditions during one step. Signs are along the direction of travel.

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


_SUM = """
def total(on, p, s, x, load, watts_per_unit):
    added = 0.0
    if on & of_kind:
{terms}
    return added
"""
_TERM = """
        if on & mask_of_{id}:
            part = {id}(p, s, x, {load})
            s.parts_w[{column}] = part * watts_per_unit
            added += part
"""


def _compose(kind: Kind, *, cumulative: bool) -> Callable[..., float]:
    """Compose all effects of a kind into one function: the sum that the active effects add to a
    load.

    It writes each effect's own power to its column of the state's `parts_w`: its contribution times
    `watts_per_unit`. With `cumulative` each effect gets the load with all before it added,
    otherwise the load alone. The columns of inactive effects stay zero. A kind without active
    effects takes one test.

    The function is written out as text because numba then compiles one function, where a chain of
    closures has a function for each effect.
    """
    names: dict[str, Any] = {"__name__": __name__}
    terms = ""
    masks = 0
    load = "load + added" if cumulative else "load"
    for index, effect in enumerate(EFFECTS):
        if effect.kind == kind:
            terms += _TERM.format(id=effect.id, load=load, column=_BASE + index)
            names |= {effect.id: effect.function, f"mask_of_{effect.id}": np.uint64(1 << index)}
            masks |= 1 << index
    names["of_kind"] = np.uint64(masks)
    exec(_SUM.format(terms=terms), names)
    total: Callable[..., float] = inline(names["total"])
    return total


_extra_force = _compose("force", cumulative=True)
_extra_drive = _compose("drive", cumulative=False)
_extra_ancillary = _compose("ancillary", cumulative=True)
_extra_battery = _compose("battery", cumulative=True)


@inline
def _paper_demand(p: Any, s: Any, x: Any, watts_per_n: float) -> Any:
    moving = x.speed_mps > 0.0
    force_n = moving * (
        model.rolling_force(p, x.cos_grade)
        + model.drag_force(p, x.speed_mps)
        + model.grade_force(p, x.sin_grade)
    )
    ancillary_w = model.ancillary_power(p, x.sensing_hz)
    drive_w = np.maximum(force_n, 0.0) * watts_per_n
    power_w = ancillary_w + drive_w - s.charger_w
    s.traction_n = force_n
    s.drive_w = drive_w
    s.power_w = power_w
    return power_w


@inline
def _demand_with_effects(p: Any, s: Any, x: Any, watts_per_n: float) -> Any:
    on = p.effects
    # Forces first, as effects of the drive take the whole force; then all loads, which drain the
    # battery together.
    _paper_demand(p, s, x, watts_per_n)
    force_n = s.traction_n + _extra_force(on, p, s, x, s.traction_n, watts_per_n)
    ancillary_w = model.ancillary_power(p, x.sensing_hz)
    ancillary_w += _extra_ancillary(on, p, s, x, ancillary_w, 1.0)
    drive_w = np.maximum(force_n, 0.0) * watts_per_n + _extra_drive(on, p, s, x, force_n, 1.0)
    terminal_w = ancillary_w + drive_w - s.charger_w
    power_w = terminal_w + _extra_battery(on, p, s, x, terminal_w, 1.0)
    s.terminal_w = terminal_w
    s.traction_n = force_n
    s.drive_w = drive_w
    s.power_w = power_w
    return power_w


@inline
def demand(p: Any, s: Any, x: Any) -> Any:
    """Power that the battery delivers under constant conditions, W.

    Args:
        p: Robot record.
        s: State record; `traction_n`, `drive_w`, `power_w` and, if any effect is on, `parts_w` are
            written.
        x: `Conditions`.
    """
    watts_per_n = model.watts_per_newton(p, x.speed_mps)
    if p.effects != 0:
        return _demand_with_effects(p, s, x, watts_per_n)
    return _paper_demand(p, s, x, watts_per_n)


def _stepper(effects: bool) -> Callable[..., Any]:
    """Make the step with or without effects: the paper's model alone stays small enough to be
    inlined."""
    power = _demand_with_effects if effects else _paper_demand

    @inline
    def step(p: Any, s: Any, x: Any, dt_s: float) -> Any:
        s.step_s = dt_s
        watts_per_n = model.watts_per_newton(p, x.speed_mps)
        power_w = power(p, s, x, watts_per_n)
        passed_s = dt_s
        spent_j = power_w * dt_s
        given_j = s.energy_j  # the most that the battery gives at this load
        if effects and p.effects & HAS_CUTOFF:
            kept_j = s.capacity_j * battery.share_below_cutoff(p, s.terminal_w)
            given_j = max(s.energy_j - kept_j, 0.0)
        if spent_j >= given_j and not s.endless:
            s.depleted = True
            # Without effects the power does not depend on the length of the step.
            if effects:
                power_w = _demand_until_empty(p, s, x, watts_per_n, given_j)
                s.ledger_j[BELOW_CUTOFF] += s.energy_j - given_j
            passed_s = 0.0
            if power_w > 0.0:
                passed_s = given_j / power_w
            spent_j = s.energy_j
        elif spent_j < 0.0 and s.energy_j - spent_j > s.capacity_j and not s.endless:
            # A full battery stores nothing: the brakes take the energy, or the charger keeps it.
            cause = CHARGER if s.charger_w > 0.0 else BRAKING
            s.ledger_j[cause] += s.energy_j - spent_j - s.capacity_j
            spent_j = s.energy_j - s.capacity_j
        s.energy_j -= spent_j
        # The ledger takes each cause's power over the time that passed: it sums to what the battery
        # lost.
        _book(p, s, x, passed_s, watts_per_n)
        if effects:
            _book_effects(p, s, x, passed_s)
        s.time_s += passed_s
        s.distance_m += x.speed_mps * passed_s
        s.speed_mps = x.speed_mps
        return passed_s

    return step


_paper_step = _stepper(effects=False)
_step_with_effects = _stepper(effects=True)


@inline
def advance(p: Any, s: Any, x: Any, dt_s: float) -> Any:
    """Advance time under constant conditions until `dt_s` is over or the battery has ended: it is
    empty, or its voltage under load has fallen to its cut-off.

    Args:
        p: Robot record.
        s: State record (`STATE_FIELDS`), updated; `depleted` is set, and stays set, when the
            battery has ended, and `ledger_j` sums to what the battery has lost.
        x: `Conditions`.
        dt_s: Time to advance, s, above zero.

    Returns:
        Time that passed, s.
    """
    if s.depleted:
        return 0.0
    if p.effects != 0:
        return _advance_by_switches(p, s, x, dt_s)
    return _paper_step(p, s, x, dt_s)


@inline
def connect(p: Any, s: Any, x: Any, charger_w: float, dt_s: float) -> Any:
    """Connect a standing robot to a charger for the next `advance`, and return for how long, s.

    The charger carries the robot and charges the battery with the rest, less the losses of the
    battery's effects. A full battery takes nothing: then the charger carries the robot only.

    Args:
        p: Robot record.
        s: State record; `charger_w` is set, and stays set.
        x: `Conditions`, at a stand.
        charger_w: Power of the charger, W; 0 for none.
        dt_s: Time to stand, s.

    Returns:
        That time or, if it is shorter, the time until the battery is full.
    """
    s.charger_w = charger_w
    if charger_w > 0.0:
        power_w = demand(p, s, x)
        room_j = s.capacity_j - s.energy_j
        if power_w < 0.0 and room_j <= _FULL * s.capacity_j:
            s.charger_w += power_w  # the charger carries the robot only
        elif power_w < 0.0:
            return min(dt_s, room_j / -power_w)
    return dt_s


@inline
def _advance_by_switches(p: Any, s: Any, x: Any, dt_s: float) -> Any:
    """Cut a step where an intermittent load switches, so that the power is constant within each
    part."""
    left_s = dt_s
    drive_j = 0.0
    spent_j = 0.0
    while True:
        part_s = left_s
        if p.effects & _INTERMITTENT:
            switch_s = intermittent_load.until_switch(p, s)
            if switch_s < left_s - intermittent_load.ROUNDING_S:
                part_s = switch_s
        passed_s = _step_with_effects(p, s, x, part_s)
        if part_s == dt_s:  # nothing switches: the step has written its own mean powers
            return passed_s
        drive_j += s.drive_w * passed_s
        spent_j += s.power_w * passed_s
        if s.depleted or part_s == left_s:
            break
        left_s -= passed_s
    total_s = dt_s
    if s.depleted:
        total_s = dt_s - left_s + passed_s
    s.drive_w = drive_j / max(total_s, 1e-9)
    s.power_w = spent_j / max(total_s, 1e-9)
    return total_s


@inline
def _demand_until_empty(p: Any, s: Any, x: Any, watts_per_n: float, given_j: float) -> Any:
    """Mean power until the battery has given what it gives, W: effects that act at the start or
    build up change it within the step."""
    low_s = 0.0
    high_s = s.step_s
    power_w = s.power_w
    for trial in range(_GUESSES + _HALVINGS):
        # The power rarely changes with the length of the step, and the first guesses usually agree.
        guess_s = high_s
        if power_w > 0.0:
            guess_s = given_j / power_w
        # Halving the interval always converges, where guesses may oscillate.
        if trial >= _GUESSES or not low_s < guess_s <= high_s:
            guess_s = 0.5 * (low_s + high_s)
        s.step_s = guess_s
        power_w = _demand_with_effects(p, s, x, watts_per_n)
        short_j = given_j - power_w * s.step_s
        if abs(short_j) <= _ROUNDING * s.energy_j:
            break
        if short_j > 0.0:
            low_s = s.step_s
        else:
            high_s = s.step_s
    return power_w


@inline
def _book(p: Any, s: Any, x: Any, passed_s: float, watts_per_n: float) -> None:
    """Add the paper's part of the energy of a step to the ledger."""
    s.ledger_j[SENSING] += model.sensing_power(p, x.sensing_hz) * passed_s
    s.ledger_j[COMMUNICATION] += p.communication_w * passed_s
    s.ledger_j[CONTROLLER] += p.controller_w * passed_s
    s.ledger_j[COMPUTER] += model.computer_power(p, x.sensing_hz) * passed_s
    s.ledger_j[CHARGER] -= s.charger_w * passed_s
    joules_per_n = (s.traction_n > 0.0) * watts_per_n * passed_s
    s.ledger_j[ROLLING] += model.rolling_force(p, x.cos_grade) * joules_per_n
    s.ledger_j[DRAG] += model.drag_force(p, x.speed_mps) * joules_per_n
    s.ledger_j[GRADE] += model.grade_force(p, x.sin_grade) * joules_per_n


@inline
def _book_effects(p: Any, s: Any, x: Any, passed_s: float) -> None:
    """Add the effects' part of the energy to the ledger, and update effects that have a state."""
    # Effects that are off have no power. The forces come first, and are booked while the drive
    # works.
    start = _BASE if s.traction_n > 0.0 else _BASE + _FORCES
    for column in range(start, _BASE + _EFFECTS):
        s.ledger_j[column] += s.parts_w[column] * passed_s
    motor_heating.remember(p, s, x)
    breakaway.remember(p, s, x)


ROBOT_STATE_DTYPE = np.dtype(list(STATE_FIELDS), align=True)


def full_charge(robot: Robot, energy_j: float | None = None) -> NDArray[np.void]:
    """State of a robot before its first step, shape (1,): battery full, or with `energy_j` in it.

    One with infinite energy does not run out; its voltage begins at that of a full battery, and
    ends at an empty one's.
    """
    state = np.zeros(1, ROBOT_STATE_DTYPE)
    state["endless"] = energy_j == np.inf
    state["energy_j"] = robot.usable_energy_j
    if energy_j is not None and energy_j != np.inf:
        state["energy_j"] = energy_j
    state["capacity_j"] = np.maximum(state["energy_j"], robot.usable_energy_j)
    return state
