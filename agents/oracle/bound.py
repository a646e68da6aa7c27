"""An upper bound of what any policy on the action grid can score on a mission, by weak duality.

A mission spends energy, time and memory. Give each a price: a joule, a second, and a sample on board, which may cost
more in one piece of the route than in another. On the way out a metre at some speed and sensing rate gives a score,
takes energy and time, and adds samples, of which the radio sends some; a second at a stand takes energy and time, and
the radio sends more. The way home takes energy and time. Whatever a policy does, its score is no more than

    the sum, over the metres that it reaches, of the best (score - price of all that the metre takes out and home)
    + price of a joule * energy of the full battery + price of a second * time limit
    + memory * (the sum of every fall of a sample's price from one piece to the next, the last to 0 where it turns),

since it spends no more energy and time than there is, has no less than nothing and no more than the memory on board at
any border of a piece, and makes no more of a metre than the best that can be made of it. This holds for all prices that
are not negative and at which no second at a stand is worth more than nothing. Linear programs find those that make the
bound small, but it does not rest on them. Where the policy turns back is left open within one place at a time; the
greatest of the places' bounds is the bound.

One thing is not proven: a robot with a full memory may drive back to where the radio is better and out again; where the
price of a sample is higher further out, that is not paid for in full. Tests try such missions: none exceeds the bound.

What is not exact is in the policy's favour. Speed and rate may change from metre to metre, where the environment takes
one decision for many; stops and turns come at any time; the battery may be empty in between; effects that remember and
only add to what is drawn are left out; on every metre of a piece the radio sends as much as at its end near home; what
does not fit on board may be samples that have found nothing. Powers, scores and samples are exact: they are those of
the environment's own step, which within a place does the same on every metre and in every second (where the radio's
power grows with distance, its least within the place is taken). Robots for which that is not so are refused.

A patrol's score is a whole number of laps, and so is its bound.

Source: Fisher, The Lagrangian relaxation method for solving integer programming problems, Management Science 27, 1981.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.agents.oracle.rates import PIECES, Array, Rates

ROUNDING = 1e-6
"""Share that is added to a bound for the rounding of its sums, which is far less."""


@dataclass(frozen=True)
class Prices:
    """Score that a joule and a second are worth, and what a sample on board costs by piece, shape (pieces,)."""

    joule: float
    second: float
    sample: Array


@dataclass(frozen=True)
class Worth:
    """What a way is worth at some prices.

    Attributes:
        way: From home to each border of a piece and back, shape (pieces + 1,).
        home: From each border home, shape (pieces + 1,).
        fallen: What the memory's falls in price up to each piece are worth, shape (pieces,).
        memory: The same with the fall to 0 at the end, shape (pieces,).
    """

    way: Array
    home: Array
    fallen: Array
    memory: Array


def allowed(rates: Rates, prices: Prices) -> Prices:
    """The prices, that of a second raised to where no second at a stand is worth more than nothing."""
    standing_w = rates.standing_w.min(axis=1)[rates.place_of_piece]
    stand = float((prices.sample * rates.radio_hz[:, 0] - prices.joule * standing_w).max())
    return Prices(prices.joule, max(prices.second, stand), prices.sample)


def worth(rates: Rates, prices: Prices) -> Worth:
    """Work out what the ways along a route are worth at their best."""
    speed, place = rates.speeds_mps[:, None], rates.place_of_piece
    sample = prices.sample[:, None, None]
    found = np.maximum(rates.gain_per_m[place] - sample * rates.samples_per_m[place], 0.0)
    sent = sample * rates.radio_hz[:, 1, None, None]
    out = (found + (sent - prices.joule * rates.out_w[place] - prices.second) / speed).max(axis=(1, 2))
    home = (-(prices.joule * rates.home_w + prices.second) / speed).max(axis=(1, 2))[place]
    fallen = rates.memory * _running_total(np.maximum(prices.sample[:-1] - prices.sample[1:], 0.0))
    return Worth(
        way=_running_total((out + home) * rates.piece_m),
        home=_running_total(home * rates.piece_m),
        fallen=fallen,
        memory=fallen + rates.memory * prices.sample,
    )


def bounds_by_turn(rates: Rates, prices: Prices) -> Array:
    """Bound of a mission that turns back within each place, shape (places,), at allowed prices."""
    value = worth(rates, prices)
    by_piece = value.memory + np.maximum(value.way[:-1], value.way[1:])
    budget = prices.joule * rates.energy_j + prices.second * rates.time_s
    return np.asarray(by_piece.reshape(rates.places, PIECES).max(axis=1) + budget)


def within_reach(rates: Rates) -> NDArray[np.bool_]:
    """Places that the battery suffices to come to and home from, shape (places,)."""
    speed = rates.speeds_mps[:, None]
    per_m = (rates.out_w / speed).min(axis=(1, 2)) + (rates.home_w / speed).min(axis=(1, 2))
    needed_j = _running_total(per_m * rates.place_m)[:-1]
    return np.asarray(needed_j <= rates.energy_j * (1.0 + ROUNDING))


def with_rounding(bound: float) -> float:
    """A bound, raised by more than its sums can be rounded down."""
    return bound + ROUNDING * abs(bound)


def patrol_bound(rates: Rates, pit_stop_s: float, prices: Prices) -> float:
    """Bound of a patrol's laps at given prices of a joule and a second.

    A lap takes the way out and home and a pit stop at either end, but the last one needs none: with n laps

        n * price of a lap <= price of the battery, the time limit and two pit stops.

    Args:
        rates: What the patrol meets.
        pit_stop_s: Length of a pit stop, s.
        prices: Of a joule and a second; what a sample costs is not used.
    """
    stops_s, stand_w = 2.0 * pit_stop_s, float(rates.standing_w.min())
    stops = (prices.joule * stand_w + prices.second) * stops_s
    per_m = (prices.joule * leg_w(rates) + prices.second) / rates.speeds_mps
    lap = float(per_m.min(axis=1).sum()) * rates.place_m + stops
    budget = prices.joule * rates.energy_j + prices.second * rates.time_s + stops
    return float(np.floor(with_rounding(budget / lap)))


def leg_w(rates: Rates) -> Array:
    """Least power by place and direction, and by speed, shape (2 * places, levels)."""
    return np.concatenate([rates.out_w.min(axis=2), rates.home_w.min(axis=2)])


def _running_total(values: Array) -> Array:
    """Sums of the first 0, 1, 2, ... values."""
    return np.concatenate([[0.0], np.cumsum(values)])
