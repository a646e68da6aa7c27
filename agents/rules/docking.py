"""Docks for the rules: how far the energy must suffice, where a mission charges, and until when."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations, feature
from homeward.envs.actions import decode_actions, encode_actions
from homeward.envs.docks import ON_BORDER
from homeward.envs.options import Known
from homeward.envs.state import STOP
from homeward.physics import ancillary_power


class Energies(NamedTuple):
    """Energies that a rule predicts, shares of the usable energy, arrays of shape (n,).

    Attributes:
        margin: Energy beyond going on, the way home and the reserve, negative where the robot turns
            without docks.
        spare: Energy beyond the way home and the reserve.
        home: Energy of the way home.
        round_trip: Energy of a round at cruise: a lap, or some decisions out and back.
    """

    margin: NDArray[np.float64]
    spare: NDArray[np.float64]
    home: NDArray[np.float64]
    round_trip: NDArray[np.float64]


class Docking:
    """Uses the docks of a mission.

    The energy must suffice to the last dock or home after going on, or else to the next dock. On
    the way out, and on patrols, the robot charges until the battery is full or lasts for the time
    that is left. On the way home it charges until the battery lasts to home, or is full. It does
    not stop where the battery would be full before the decision is over, because the rest of the
    decision would be lost.

    Args:
        known: Constants of the environment, with docks.
        round_m: Length of a round, m.
        round_s: Its time, s.
    """

    def __init__(self, known: Known, round_m: float, round_s: float) -> None:
        s = known.shared[0]
        docks = s["docks"][: int(s["dock_count"])]
        self._known = known
        self._round_m = round_m
        self._round_s = round_s
        self._position_m = docks["position_m"]
        idle_w = float(ancillary_power(known.robot, 0.0))
        self._charge_w = docks["charger_w"] - idle_w
        self._idle_share = idle_w * s["decision_s"] / s["usable_j"]
        # A patrol charges in its pit stops anyway, once at each post on a round.
        at_post = (self._position_m <= 0.0) | (
            self._position_m >= thresholds.AT_END * s["length_m"]
        )
        self._round_share = float(
            docks["charger_w"][at_post].sum() * s["pit_stop_s"] / s["usable_j"]
        )
        drives = encode_actions(known, s["cruise_mps"], 0.0, STOP)
        way_m = float(decode_actions(known, drives).speed_mps[0] * s["decision_s"])
        self._way_m = (1.0 - ON_BORDER) * way_m  # observed distances are rounded
        self._last = np.zeros((3, 0))  # time, energy supplied and position at the last decision
        self._full = np.zeros(0, np.bool_)

    def must_turn(self, observations: Observations, energies: Energies) -> NDArray[np.bool_]:
        """Which missions have only the time left for the way home and for charging what it needs,
        shape (n,)."""
        short_j = np.maximum(-energies.spare, 0.0) * self._known.shared["usable_j"][0]
        charging_s = short_j / self._charge_w.min()
        return np.asarray(
            self._left_s(observations) < thresholds.HOME_TIME * (self._round_s + charging_s)
        )

    def margin(self, observations: Observations, energies: Energies) -> NDArray[np.float64]:
        """Energy beyond going on and back to the last dock, or on to the next one, and the reserve,
        shape (n,)."""
        home_cost = feature(observations, "home_cost")
        dock_cost = feature(observations, "dock_cost")
        # The part of the way home beyond the last dock need not be in the battery.
        beyond = energies.home * (1.0 - dock_cost / np.maximum(home_cost, 1e-9))
        back = energies.margin + np.where(home_cost > 0.0, beyond, 0.0)
        outwards = feature(observations, "outbound") > 0.0
        ahead = np.where(
            outwards, feature(observations, "dock_out"), feature(observations, "dock_back")
        )
        ahead_m = ahead * self._known.shared["reach_m"][0]
        onwards = energies.spare + energies.home - ahead_m * energies.round_trip / self._round_m
        return np.where(ahead_m > 0.0, np.maximum(back, onwards), back)

    def stops(
        self,
        observations: Observations,
        begun: NDArray[np.bool_],
        energies: Energies,
        turned: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Which missions stop at the next dock, because they reach it in this decision and charge
        there, shape (n,).

        Args:
            observations: As in `Policy.act`, like the next.
            begun: Shape (n,).
            energies: Energies of the rule.
            turned: Which missions head home, shape (n,).
        """
        s = self._known.shared[0]
        position_m = feature(observations, "distance") * s["reach_m"]
        ahead_m = feature(observations, "outbound")[:, None] * (
            self._position_m - position_m[:, None]
        )
        # not the docks behind
        ahead_m = np.where(ahead_m < -ON_BORDER * s["place_m"], np.inf, ahead_m)
        decision_share = self._charge_w[ahead_m.argmin(axis=1)] * s["decision_s"] / s["usable_j"]
        full = self._is_full(observations, begun, position_m, 0.5 * decision_share)
        full |= 1.0 - feature(observations, "metered") < decision_share
        rounds = self._left_s(observations) / self._round_s
        all_rounds = np.maximum(energies.round_trip - self._round_share, 0.0) * rounds
        needed = np.where(turned, 0.0, np.maximum(all_rounds, energies.round_trip))
        # A return that is not final drives towards home, and not to the dock ahead.
        heads_on = ~turned | (feature(observations, "returning") >= 1.0)
        reaches = ahead_m.min(axis=1) <= self._way_m
        return np.asarray(reaches & heads_on & ~full & (energies.spare < needed))

    def _left_s(self, observations: Observations) -> NDArray[np.float64]:
        """Time left before the way home, s, shape (n,)."""
        s = self._known.shared[0]
        left_s = (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        home_s = feature(observations, "distance") * s["reach_m"] / s["cruise_mps"]
        return np.asarray(left_s - thresholds.HOME_TIME * home_s)

    def _is_full(
        self,
        observations: Observations,
        begun: NDArray[np.bool_],
        position_m: NDArray[np.float64],
        least_share: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Which batteries are full: in a decision at the dock they took less than `least_share`,
        shape (n,)."""
        time = feature(observations, "time")
        supplied = feature(observations, "supplied")
        now = np.stack((time, supplied, position_m))
        if len(begun) != len(self._full):
            self._last = now.copy()
            self._full = np.zeros(len(begun), np.bool_)
        last_time, last_supplied, last_position_m = self._last
        later = time > last_time
        took = supplied - last_supplied - self._idle_share
        takes_little = (position_m == last_position_m) & (took < least_share)
        # A repeated decision tells nothing new.
        self._full = ~begun & np.where(later, takes_little, self._full)
        self._last = np.where(later | begun, now, self._last)
        return self._full
