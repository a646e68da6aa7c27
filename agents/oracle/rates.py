"""Powers, score, samples and radio along a route, measured with full knowledge by the environment's
own step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.agents.oracle import kernel
from homeward.agents.oracle.problem import Problem
from homeward.agents.thresholds import AT_END
from homeward.envs.actions import LEVELS, at_level
from homeward.physics.effects import EFFECTS

PIECES = 2
"""Pieces of each place; multiplier of a sample and rate of the radio differ by piece. Chosen: more
pieces tighten the bound and enlarge the linear programs."""
ONLY_ADDING = ("breakaway", "intermittent_load", "motor_heating")
"""Effects with a state that can only increase consumption: without them the bound is higher, and
still valid."""
REFUSED = ("inertia",)
"""Effects whose power depends on more than the place: energy that one decision consumes may be
recovered later."""
_BATTERY = tuple(effect.id for effect in EFFECTS if effect.kind == "battery")
_BITS = {effect.id: np.uint64(1 << index) for index, effect in enumerate(EFFECTS)}

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rates:
    """Rates of driving and standing along a route.

    Attributes:
        speeds_mps: Speeds of the action grid, m/s, shape (levels,).
        place_m: Length of a place, m.
        out_w: Power away from home by place, speed and sensing rate, W, shape (places, levels,
            levels).
        home_w: Power towards home, as above.
        standing_w: Power at a stand by place and sensing rate, W, shape (places, levels).
        post_w: Least power in a pit stop at home and at the far end, W, shape (2,); negative at a
            dock.
        charge_w: Power into the battery at each dock without its losses, W, shape (docks,).
        gain_per_m: Score per metre reached for the first time, shape (places, levels, levels).
        samples_per_m: Samples taken per metre, as above.
        radio_hz: Samples sent per second at the end of a piece near home, at a stand and moving,
            shape (pieces, 2).
        energy_j: Energy of the full battery, J.
        time_s: Time limit, s.
        memory: Samples that fit on board.
    """

    speeds_mps: Array
    place_m: float
    out_w: Array
    home_w: Array
    standing_w: Array
    post_w: Array
    charge_w: Array
    gain_per_m: Array
    samples_per_m: Array
    radio_hz: Array
    energy_j: float
    time_s: float
    memory: float

    @property
    def places(self) -> int:
        """Number of places."""
        return len(self.out_w)

    @property
    def place_of_piece(self) -> NDArray[np.int64]:
        """Index of the place that each piece is in, shape (pieces,)."""
        return np.arange(len(self.radio_hz)) // PIECES

    @property
    def pit_stop_w(self) -> float:
        """Mean power of the two pit stops of a lap, W."""
        return float(self.post_w.mean())

    @property
    def piece_m(self) -> float:
        """Length of a piece, m."""
        return self.place_m / PIECES


def measure_rates(case: Problem) -> Rates:
    """Measure the rates of a mission; its robot must have none of the effects `REFUSED`."""
    energy_j = float(case.start["energy_j"][0])
    case = case.copy()
    for record in (case.robot, case.constants["nominal"]):
        for effect in ONLY_ADDING:
            record["effects"] &= ~_BITS[effect]
    charge_w = _charge_w(case)
    s = case.shared
    s["dock_count"] = 0  # so that a stand at a dock is measured without its charger
    places = int(s["places"])
    by_action = (places, LEVELS, LEVELS)
    rates = Rates(
        speeds_mps=at_level(np.arange(LEVELS), s["min_speed_mps"], s["max_speed_mps"]),
        place_m=float(s["place_m"]),
        out_w=np.zeros(by_action),
        home_w=np.zeros(by_action),
        standing_w=np.zeros((places, LEVELS)),
        post_w=np.zeros(2),
        charge_w=charge_w,
        gain_per_m=np.zeros(by_action),
        samples_per_m=np.zeros(by_action),
        radio_hz=np.zeros((places * PIECES, 2)),
        energy_j=energy_j,
        time_s=float(s["max_decisions"] * s["decision_s"]),
        memory=float(s["backlog_limit"]),
    )
    # so that the battery has room for the energy that a descent returns
    case.start["energy_j"] *= 0.5
    kernel.measure(
        case.constants, case.robot, case.route, case.start, case.start.copy(), PIECES, rates.out_w, rates.home_w,
        rates.standing_w, rates.gain_per_m, rates.samples_per_m, rates.radio_hz,
    )  # fmt: skip
    rates.post_w[:] = rates.standing_w.min()
    for position_m, power_w in zip(s["docks"]["position_m"], charge_w, strict=False):
        if position_m <= 0.0:
            rates.post_w[0] = -power_w
        elif position_m >= AT_END * s["length_m"]:
            rates.post_w[1] = -power_w
    return rates


def _charge_w(case: Problem) -> Array:
    """Power into the battery at each dock, W, shape (docks,), without the losses of the battery's
    effects."""
    case = case.copy()
    for record in (case.robot, case.constants["nominal"]):
        for effect in _BATTERY:
            record["effects"] &= ~_BITS[effect]
    charge_w = np.zeros(int(case.shared["dock_count"]))
    if len(charge_w):
        case.start["energy_j"] *= 0.5  # a full battery takes nothing
        kernel.charge(
            case.constants, case.robot, case.route, case.start, case.start.copy(), charge_w
        )
    return charge_w
