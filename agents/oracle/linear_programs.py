"""Linear programs whose plans may change speed and rate from metre to metre, and the multipliers of
their duals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from homeward.agents.oracle.bound import (
    Multipliers,
    bounds_by_turn,
    dual_feasible,
    dual_feasible_at_docks,
    leg_w,
    patrol_bound,
    with_rounding,
    within_reach,
)
from homeward.agents.oracle.rates import PIECES, Array, Rates
from homeward.envs.actions import LEVELS


@dataclass(frozen=True)
class Plan:
    """Optimal plan of a mission out and back that turns within a given place.

    Attributes:
        turn: Index of that place.
        multipliers: Lagrange multipliers of the limits, made valid by `dual_feasible`.
        energy_j: Energy left at the far end of each piece up to that place, J, shape (pieces,).
        backlog: Samples on board there, shape (pieces,).
    """

    turn: int
    multipliers: Multipliers
    energy_j: Array
    backlog: Array


def bound_out_and_back(rates: Rates) -> tuple[float, Plan]:
    """Upper bound of the score of a mission out and back, and the plan of the place where it is
    greatest.

    The multipliers of a plan bound the score of a turn in every place. So the place with the
    greatest bound so far is planned next, until it already has a plan.
    """
    bounds = np.where(within_reach(rates), np.inf, -np.inf)
    plans: dict[int, Plan | None] = {}
    turn = int(np.flatnonzero(bounds == np.inf)[-1]) // 2
    while turn not in plans:
        plan = plan_out_and_back(rates, turn)
        plans[turn] = plan
        # otherwise there is no time to turn there, and the bound by other multipliers stays
        if plan:
            bounds = np.minimum(bounds, bounds_by_turn(rates, plan.multipliers))
        turn = int(np.argmax(bounds))
    best_plan = max((plan for plan in plans.values() if plan), key=lambda plan: bounds[plan.turn])
    return with_rounding(float(bounds[turn])), best_plan


def plan_out_and_back(rates: Rates, turn: int) -> Plan | None:
    """Plan a mission that turns within a place, by linear programming, or None if energy or time do
    not suffice."""
    pieces = (turn + 1) * PIECES
    ways = LEVELS * LEVELS
    place = rates.place_of_piece[:pieces]
    speed = rates.speeds_mps
    per_speed = np.broadcast_to(1.0 / speed[:, None], (pieces, LEVELS, LEVELS))
    out_j = rates.out_w[place] * per_speed
    home_j = rates.home_w.min(axis=2)[place] / speed
    standing_w = rates.standing_w.min(axis=1)[place]
    # Columns: metres out by speed and rate, metres home by speed, seconds at a stand, samples on
    # board at the far end, samples sent, and the share of the piece that is reached; for every
    # piece.
    widths = [pieces * columns for columns in (ways, LEVELS, 1, 1, 1, 1)]
    none_of_three = np.zeros(3 * pieces)
    eye = sparse.identity(pieces)
    increase = eye - sparse.eye(pieces, k=-1)  # a piece less the one before
    next_less_this = sparse.eye(pieces, k=1) - eye  # the next piece less this one
    driven_out = _per_piece(np.ones((pieces, ways)))
    driven_home = _per_piece(np.ones((pieces, LEVELS)))
    samples = _per_piece(rates.samples_per_m[place])
    sent_moving = _per_piece(rates.radio_hz[:pieces, 1, None, None] * per_speed)
    sent_standing = sparse.diags(rates.radio_hz[:pieces, 0])
    equal = sparse.vstack([
        _rows(widths, {0: driven_out, 5: -rates.piece_m * eye}),
        _rows(widths, {1: driven_home, 5: -rates.piece_m * eye}),
        _rows(widths, {0: -samples, 3: increase, 4: eye}),
    ])  # fmt: skip
    joules = np.concatenate([out_j.ravel(), home_j.ravel(), standing_w, none_of_three])
    seconds = np.concatenate(
        [per_speed.ravel(), np.tile(1.0 / speed, pieces), np.ones(pieces), none_of_three]
    )
    limits = sparse.vstack([
        sparse.csr_matrix(joules),
        sparse.csr_matrix(seconds),
        _rows(widths, {0: -sent_moving, 2: -sent_standing, 4: eye}),
        _rows(widths, {5: next_less_this})[:-1],  # a piece is reached through the one before
    ])  # fmt: skip
    gain = np.zeros(sum(widths))
    low = np.zeros(sum(widths))
    high = np.full(sum(widths), np.inf)
    gain[: widths[0]] = rates.gain_per_m[place].ravel()
    # all pieces before the place of the turn are reached
    low[-pieces:] = np.arange(pieces) < turn * PIECES
    high[-pieces:] = 1.0
    high[-3 * pieces : -2 * pieces] = rates.memory
    room = np.concatenate([[rates.energy_j, rates.time_s], np.zeros(2 * pieces - 1)])
    result = _most(gain, limits, room, equal, np.stack([low, high], axis=1))
    if result.status != 0:
        return None
    # The multipliers are the marginals of the limits: negative in a minimisation, up to rounding.
    per_j, per_s = np.maximum(-result.ineqlin.marginals[:2], 0.0)
    by_piece = np.maximum(result.eqlin.marginals[2 * pieces :], 0.0)
    by_piece = np.pad(by_piece, (1, len(rates.radio_hz) - pieces + 1), mode="edge")
    per_sample = 0.5 * (by_piece[:-1] + by_piece[1:])  # at the borders
    metres, _, stands_s, backlog, _, _ = np.split(result.x, np.cumsum(widths[:-1]))
    driven_j = (metres * out_j.ravel()).reshape(pieces, ways).sum(axis=1)
    spent_j = driven_j + stands_s * standing_w
    multipliers = dual_feasible(rates, Multipliers(float(per_j), float(per_s), per_sample))
    energy_j = rates.energy_j - np.cumsum(spent_j)
    return Plan(turn, multipliers, energy_j, backlog)


def bound_patrol(rates: Rates, pit_stop_s: float) -> tuple[float, Multipliers]:
    """Upper bound of the number of laps of a patrol, and its multipliers, in laps per J and per
    s."""
    speed = rates.speeds_mps
    power_w = leg_w(rates)
    legs = len(power_w)
    stops_s = 2.0 * pit_stop_s
    stand_w = rates.pit_stop_w
    # Columns: metres by leg and speed, laps, and seconds at each dock.
    docks = np.zeros(len(rates.charge_w))
    joules = np.concatenate(
        [(power_w / speed).ravel(), [stops_s * stand_w], docks - rates.charge_w]
    )
    seconds = np.concatenate([np.tile(1.0 / speed, legs), [stops_s], docks + 1.0])
    laps = np.concatenate(
        [np.full((legs, 1), -rates.place_m), np.zeros((legs, len(docks)))], axis=1
    )
    driven = sparse.hstack([_per_piece(np.ones((legs, LEVELS))), sparse.csr_matrix(laps)])
    room = np.array([rates.energy_j + stops_s * stand_w, rates.time_s + stops_s])
    gain = np.concatenate([np.zeros(power_w.size), [1.0], docks])
    result = _most(gain, np.stack([joules, seconds]), room, driven, (0.0, None))
    per_j, per_s = np.maximum(-result.ineqlin.marginals, 0.0)
    prices = Multipliers(float(per_j), float(per_s), np.zeros(len(rates.radio_hz) + 1))
    multipliers = dual_feasible_at_docks(rates, prices)
    return patrol_bound(rates, pit_stop_s, multipliers), multipliers


def _most(gain: Array, limits: Any, room: Array, equal: Any, bounds: Any) -> Any:
    """Maximise gain @ x subject to limits @ x <= room and equal @ x = 0, with (low, high) bounds of
    each x."""
    return linprog(-gain, limits, room, equal, np.zeros(equal.shape[0]), bounds, method="highs")


def _per_piece(values: Array) -> Any:
    """Block diagonal of the values of each piece, flattened: shape (pieces, pieces * values of a
    piece)."""
    return sparse.block_diag(list(values.reshape(len(values), 1, -1)))


def _rows(widths: list[int], blocks: dict[int, Any]) -> Any:
    """Rows of a sparse matrix with blocks in some groups of columns, of the given widths, and zeros
    in the others."""
    height = next(iter(blocks.values())).shape[0]
    empty = [sparse.csr_matrix((height, width)) for width in widths]
    return sparse.hstack([blocks.get(group, empty[group]) for group in range(len(widths))]).tocsr()
