"""An upper bound of what any policy on the action grid can score on a mission, by weak duality.

A mission spends energy, time and memory. Give each a price: a joule, a second, and a sample on board, whose price is
linear in position within each piece of the route. On the way out a metre at some speed and sensing rate gives a score,
takes energy and time, and adds samples, of which the radio sends some; a second at a stand takes energy and time, and
the radio sends more. The way home consumes energy and time. Whatever a policy does, its score is no more than

    the sum, over the metres that it reaches, of the best (score - price of all that the metre takes out and home)
    + price of a joule * energy of the full battery + price of a second * time limit
    + memory * (the sum of every fall of a sample's price on the way out, the last to 0 where it turns),

since it spends no more energy and time than there is, has no less than nothing and no more than the memory on board,
and makes no more of a metre than the best that can be made of it. A robot may also drive back to where the radio is
better, and out again. It finds nothing new there, and samples taken there only take room, so that it passes each metre
outwards with no more on board than inwards: the pass gains at most the memory times the metre's rise in price, and
takes energy and time both ways. So all this holds for all prices that are not negative, of which no second at a stand
and no such pass is worth more than nothing. Linear programs find those that make the bound small, but it does not rest
on them. Where the policy turns back is left open within one place at a time; the greatest of the places' bounds is the
bound. The best that can be made of a metre is convex in the price of a sample, so that over a piece it is no more than
what the chord between its two borders gives.

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
    """Score that a joule and a second are worth, and what a sample on board costs at the borders of the pieces."""

    joule: float
    second: float
    sample: Array  # shape (pieces + 1,)


@dataclass(frozen=True)
class Worth:
    """What a way is worth at some prices.

    Attributes:
        way: From home to each border of a piece and back, shape (pieces + 1,).
        part: From the near border of a piece to a turn in it and back, at most, shape (pieces,).
        home: From each border home, shape (pieces + 1,).
        fallen: What the memory's falls in price up to each border are worth, shape (pieces + 1,).
        memory: The same up to a turn within each piece, with the fall to 0 there, shape (pieces,).
    """

    way: Array
    part: Array
    home: Array
    fallen: Array
    memory: Array


def allowed(rates: Rates, prices: Prices) -> Prices:
    """The prices, changed to where no second at a stand and no pass in and out again is worth more than nothing.

    The price of a second is raised as far as it takes; that of a sample rises outwards no faster than a pass takes.
    """
    sample, standing_w = _greater(prices.sample), rates.standing_w.min(axis=1)[rates.place_of_piece]
    stand = float((sample * rates.radio_hz[:, 0] - prices.joule * standing_w).max())
    second = max(prices.second, stand)
    least = float(_pass(rates, prices.joule, second, sample).min())
    second += 0.5 * max(-least, 0.0) * float(rates.speeds_mps[-1])  # of two ways, each at this speed or slower
    rises = np.maximum(_pass(rates, prices.joule, second, sample), 0.0) * rates.piece_m / rates.memory
    limit = _running_total(rises)
    return Prices(prices.joule, second, limit + np.minimum.accumulate(prices.sample - limit))


def _pass(rates: Rates, joule: float, second: float, sample: Array) -> Array:
    """What a metre inwards and outwards again takes at least, by piece, shape (pieces,)."""
    saved = sample * rates.radio_hz[:, 1]
    least_w = np.stack([rates.home_w, rates.out_w]).min(axis=3)[:, rates.place_of_piece]
    per_m = (joule * least_w + second - saved[:, None]) / rates.speeds_mps
    return np.asarray(per_m.min(axis=2).sum(axis=0))


def _greater(at_borders: Array) -> Array:
    """The greater one of the two borders of each piece."""
    return np.maximum(at_borders[:-1], at_borders[1:])


def worth(rates: Rates, prices: Prices) -> Worth:
    """Work out what the ways along a route are worth at their best."""
    speed, place = rates.speeds_mps[:, None], rates.place_of_piece
    home = (-(prices.joule * rates.home_w + prices.second) / speed).max(axis=(1, 2))[place]

    def metre(sample: Array) -> Array:
        """Worth of a metre of each piece, out and home, shape (pieces,)."""
        found = np.maximum(rates.gain_per_m[place] - sample[:, None, None] * rates.samples_per_m[place], 0.0)
        sent = (sample * rates.radio_hz[:, 1])[:, None, None]
        out = found + (sent - prices.joule * rates.out_w[place] - prices.second) / speed
        return np.asarray(out.max(axis=(1, 2)) + home)

    near, far = metre(prices.sample[:-1]), metre(prices.sample[1:])
    fallen = rates.memory * _running_total(np.maximum(prices.sample[:-1] - prices.sample[1:], 0.0))
    return Worth(
        way=_running_total(0.5 * (near + far) * rates.piece_m),
        part=0.5 * (np.maximum(near, 0.0) + np.maximum(far, 0.0)) * rates.piece_m,
        home=_running_total(home * rates.piece_m),
        fallen=fallen,
        memory=fallen[:-1] + rates.memory * _greater(prices.sample),
    )


def bounds_by_turn(rates: Rates, prices: Prices) -> Array:
    """Bound of a mission that turns back within each place, shape (places,), at allowed prices."""
    value = worth(rates, prices)
    by_piece = value.memory + value.way[:-1] + value.part
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
