"""Upper bound of the score of any policy on the action grid, by Lagrangian relaxation and weak
duality.

A mission is limited by energy, time and memory. The limits have Lagrange multipliers, in score per
J, per s and per sample on board; that of a sample is linear in position within each piece of the
route. On the way out a metre at some speed and sensing rate adds score, consumes energy and time,
and adds samples, of which the radio sends some. A second at a stand consumes energy and time, and
the radio sends more. The way home consumes energy and time. The Lagrangian of any of these is its
score less its consumption, each at its multiplier. The score of any policy is at most

    the sum, over the metres that it reaches, of the greatest Lagrangian of the metre, out and home
    + multiplier of energy * energy of the full battery + multiplier of time * time limit
    + memory * (sum of every decrease of a sample's multiplier on the way out, the last to 0 where
    it turns),

because consumption is within the limits, the samples on board are between none and the memory, and
no metre exceeds its greatest Lagrangian. A robot may also drive back to where the radio is better,
and out again. It finds nothing new there, and samples taken there only fill the memory, so it
passes each metre outwards with no more samples than inwards. Such a pass gains at most the memory
times the increase of the multiplier over the metre, and consumes energy and time both ways. The
bound therefore holds for all non-negative multipliers at which neither a second at a stand nor such
a pass has a positive Lagrangian (`dual_feasible`). Linear programs find multipliers that make it
small, but it does not depend on them. It is computed for a turn within each place; the greatest of
these is the bound. The greatest Lagrangian of a metre is convex in the multiplier of a sample, so
its mean over a piece is at most that of the piece's two borders.

All approximations favour the policy. Speed and rate may change from metre to metre, where the
environment takes one decision for many; stops and turns come at any time; the battery may be empty
in between; effects with a state that only increase consumption are left out; on every metre of a
piece the radio sends as much as at its end near home; samples that do not fit on board may be those
without information. Powers, scores and samples are exact: they are those of the environment's own
step, which are constant within a place (where the radio's power grows with distance, its least
within the place is taken). Robots for which they are not are refused.

A patrol's score is a whole number of laps, and so is its bound. At a dock a second adds energy and
consumes time; the bound holds where that has no positive Lagrangian either
(`dual_feasible_at_docks`). It favours the policy in two more ways: the battery may be charged
beyond full, and without losses.

Source: Fisher, The Lagrangian relaxation method for solving integer programming problems,
Management Science 27, 1981.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.agents.oracle.rates import PIECES, Array, Rates

ROUNDING = 1e-6
"""Relative increase of a bound to cover the rounding of its sums. Chosen: far above that, some
hundred terms in double precision (1e-13), and far below what a score is compared to."""


@dataclass(frozen=True)
class Multipliers:
    """Lagrange multipliers: score per J, per s, and per sample on board at the borders of the
    pieces."""

    per_j: float
    per_s: float
    per_sample: Array  # shape (pieces + 1,)


@dataclass(frozen=True)
class LagrangianSums:
    """Greatest Lagrangian along the route at some multipliers, as a score.

    Attributes:
        way: From home to each border of a piece and back, shape (pieces + 1,).
        part: Upper bound from the near border of a piece to a turn in it and back, shape (pieces,).
        home: From each border home, shape (pieces + 1,).
        fallen: Memory times the decreases of a sample's multiplier up to each border, shape (pieces
            + 1,).
        memory: The same up to a turn within each piece, with the decrease to 0 there, shape
            (pieces,).
    """

    way: Array
    part: Array
    home: Array
    fallen: Array
    memory: Array


def dual_feasible(rates: Rates, multipliers: Multipliers) -> Multipliers:
    """Change multipliers so that neither a second at a stand nor a pass in and out again has a
    positive Lagrangian.

    That of time is raised as far as needed. That of a sample is lowered where it rises outwards
    faster than allowed.
    """
    sample = _greater(multipliers.per_sample)
    standing_w = rates.standing_w.min(axis=1)[rates.place_of_piece]
    stand = float((sample * rates.radio_hz[:, 0] - multipliers.per_j * standing_w).max())
    per_s = max(multipliers.per_s, stand)
    least_pass = float(_pass(rates, multipliers.per_j, per_s, sample).min())
    # A metre of the pass is driven inwards and outwards, each at the fastest speed or slower.
    per_s += 0.5 * max(-least_pass, 0.0) * float(rates.speeds_mps[-1])
    rises = (
        np.maximum(_pass(rates, multipliers.per_j, per_s, sample), 0.0)
        * rates.piece_m
        / rates.memory
    )
    limit = _running_total(rises)
    per_sample = limit + np.minimum.accumulate(multipliers.per_sample - limit)
    return Multipliers(multipliers.per_j, per_s, per_sample)


def dual_feasible_at_docks(rates: Rates, multipliers: Multipliers) -> Multipliers:
    """Raise the multiplier of time so far that no second at a dock has a positive Lagrangian."""
    charging = multipliers.per_j * float(rates.charge_w.max(initial=0.0))
    per_s = max(multipliers.per_s, charging)
    return Multipliers(multipliers.per_j, per_s, multipliers.per_sample)


def _pass(rates: Rates, per_j: float, per_s: float, sample: Array) -> Array:
    """Least consumption of a metre inwards and out again, less that of samples sent, as a score,
    shape (pieces,)."""
    saved = sample * rates.radio_hz[:, 1]
    least_w = np.stack([rates.home_w, rates.out_w]).min(axis=3)[:, rates.place_of_piece]
    per_m = (per_j * least_w + per_s - saved[:, None]) / rates.speeds_mps
    return np.asarray(per_m.min(axis=2).sum(axis=0))


def _greater(at_borders: Array) -> Array:
    """The greater of the values at the two borders of each piece, shape (pieces,)."""
    return np.maximum(at_borders[:-1], at_borders[1:])


def lagrangian_sums(rates: Rates, multipliers: Multipliers) -> LagrangianSums:
    """Sum the greatest Lagrangian of each metre along the route."""
    speed = rates.speeds_mps[:, None]
    place = rates.place_of_piece
    home_by_place = (-(multipliers.per_j * rates.home_w + multipliers.per_s) / speed).max(
        axis=(1, 2)
    )
    home = home_by_place[place]

    def metre(sample: Array) -> Array:
        """Greatest Lagrangian of a metre of each piece, out and home, score per metre, shape
        (pieces,)."""
        memory_cost = sample[:, None, None] * rates.samples_per_m[place]
        gain = np.maximum(rates.gain_per_m[place] - memory_cost, 0.0)
        sent = (sample * rates.radio_hz[:, 1])[:, None, None]
        out = gain + (sent - multipliers.per_j * rates.out_w[place] - multipliers.per_s) / speed
        return np.asarray(out.max(axis=(1, 2)) + home)

    at_near_border = multipliers.per_sample[:-1]
    at_far_border = multipliers.per_sample[1:]
    near = metre(at_near_border)
    far = metre(at_far_border)
    fallen = rates.memory * _running_total(np.maximum(at_near_border - at_far_border, 0.0))
    # Convex in the multiplier of a sample: the mean over a piece is at most that of its borders.
    return LagrangianSums(
        way=_running_total(0.5 * (near + far) * rates.piece_m),
        part=0.5 * (np.maximum(near, 0.0) + np.maximum(far, 0.0)) * rates.piece_m,
        home=_running_total(home * rates.piece_m),
        fallen=fallen,
        memory=fallen[:-1] + rates.memory * _greater(multipliers.per_sample),
    )


def bounds_by_turn(rates: Rates, multipliers: Multipliers) -> Array:
    """Bound of a mission that turns back within each place, shape (places,), at dual feasible
    multipliers."""
    sums = lagrangian_sums(rates, multipliers)
    by_piece = sums.memory + sums.way[:-1] + sums.part
    budget = multipliers.per_j * rates.energy_j + multipliers.per_s * rates.time_s
    return np.asarray(by_piece.reshape(rates.places, PIECES).max(axis=1) + budget)


def within_reach(rates: Rates) -> NDArray[np.bool_]:
    """Places to which the battery suffices, out and home, shape (places,)."""
    speed = rates.speeds_mps[:, None]
    per_m = (rates.out_w / speed).min(axis=(1, 2)) + (rates.home_w / speed).min(axis=(1, 2))
    needed_j = _running_total(per_m * rates.place_m)[:-1]
    return np.asarray(needed_j <= rates.energy_j * (1.0 + ROUNDING))


def with_rounding(bound: float) -> float:
    """A bound increased by `ROUNDING`."""
    return bound + ROUNDING * abs(bound)


def patrol_bound(rates: Rates, pit_stop_s: float, multipliers: Multipliers) -> float:
    """Upper bound of the number of laps of a patrol at given multipliers.

    A lap consumes energy and time on the way out, on the way home, and in a pit stop at either end,
    but the last one needs none. With the consumption at the multipliers, n laps satisfy

        n * consumption of a lap <= full battery + time limit + two pit stops.

    Args:
        rates: Rates of the patrol.
        pit_stop_s: Length of a pit stop, s.
        multipliers: Multipliers of energy and time, feasible at the docks; that of a sample is not
            used.
    """
    stops_s = 2.0 * pit_stop_s
    stops = (multipliers.per_j * rates.pit_stop_w + multipliers.per_s) * stops_s
    per_m = (multipliers.per_j * leg_w(rates) + multipliers.per_s) / rates.speeds_mps
    lap = float(per_m.min(axis=1).sum()) * rates.place_m + stops
    budget = multipliers.per_j * rates.energy_j + multipliers.per_s * rates.time_s + stops
    return float(np.floor(with_rounding(budget / lap)))


def leg_w(rates: Rates) -> Array:
    """Least power by place, first outwards and then homewards, and by speed, W, shape (2 * places,
    levels)."""
    return np.concatenate([rates.out_w.min(axis=2), rates.home_w.min(axis=2)])


def _running_total(values: Array) -> Array:
    """Sums of the first 0, 1, 2, ... values, shape (n + 1,)."""
    return np.concatenate([[0.0], np.cumsum(values)])
