"""Common part of all rules for turning back: forced turns, where a patrol may turn, and the energy
of going on."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations, Policy, feature
from homeward.agents.rules.docking import Docking, Energies
from homeward.agents.rules.pace import Pace
from homeward.envs.features import SINE_UNIT
from homeward.envs.options import Known
from homeward.envs.routes import thresholds as routes_thresholds
from homeward.physics import ancillary_power, below_cutoff, d_max


class Outlook(NamedTuple):
    """Belief about the energy left and that of the way home, shares of the usable energy, arrays of
    shape (n,).

    Attributes:
        energy_left: Mean of the energy left.
        home: Mean of the energy of the way home.
        onwards: Mean of the energy of going on to the next chance to turn, and back.
        deviation: Standard deviation of the margin, energy_left - home - onwards.
    """

    energy_left: NDArray[np.float64]
    home: NDArray[np.float64]
    onwards: NDArray[np.float64]
    deviation: NDArray[np.float64]


class TurnBackRule(Policy):
    """Goes on while there is enough energy, and then heads home.

    It also heads home at the far end of the route, and when only enough time is left. A patrol
    decides at its home post whether another lap fits. With docks, the energy must suffice to the
    next one, in either direction, or home, and the rule charges at those that it passes
    (`Docking`).

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.

    Attributes:
        charges: Which missions stop at a dock in the last decision, shape (n,).
        margin: Energy beyond the reserve in the last decision, the docks included, shape (n,).
    """

    chances = 2.0
    """Number of decisions for which going on is predicted: the next one, and another for unknown
    ground."""

    def __init__(self, known: Known, pace: Pace) -> None:
        self._known = known
        self._pace = pace
        self._turned = np.zeros(0, np.bool_)
        s = known.shared[0]
        self._shuttles = bool(s["shuttles"])
        self._sines = np.linspace(
            -routes_thresholds.STEEPEST_SINE, routes_thresholds.STEEPEST_SINE, 281
        )
        # Eq. 8 with a full battery: share of it that a metre consumes at each grade, and that stays
        # in it below its cut-off.
        cruise_mps = float(s["cruise_mps"])
        grades_rad = np.arcsin(self._sines)
        self._shares_per_m = 1.0 / np.asarray(
            d_max(known.robot.without_cutoff(), cruise_mps, grades_rad)
        )
        self._shares_kept = below_cutoff(known.robot, cruise_mps, grades_rad) / s["usable_j"]
        self._reach_m = float(s["reach_m"])
        self._sees_posts = sees_posts(known)
        idle_w, busy_w = ancillary_power(
            known.robot, np.array([0.0, pace.rate * s["max_sensing_hz"]])
        )
        # Going on: some decisions out and back, on a patrol a lap with its two pit stops.
        outward_s = self.chances * s["decision_s"]
        extra_j = outward_s * (busy_w - idle_w)
        if self._shuttles:
            outward_s = max(outward_s, s["length_m"] / s["cruise_mps"])
            extra_j = 2.0 * s["pit_stop_s"] * idle_w
        self._outward_m = float(outward_s * s["cruise_mps"])
        self._extra_share = float(extra_j / s["usable_j"])
        self._round_s = float(2.0 * (outward_s + s["pit_stop_s"]))
        self._round_m = 2.0 * self._outward_m
        self._docking: Docking | None = None
        if s["dock_count"]:
            self._docking = Docking(known, self._round_m, self._round_s)
        self.charges = self._turned.copy()
        self.margin = np.zeros(0)

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        return self.drive(observations, self.turns(observations, begun))

    def turns(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which missions head home, including those already returning, shape (n,). Arguments as in
        `act`."""
        s = self._known.shared[0]
        distance_m = feature(observations, "distance") * self._reach_m
        if len(begun) != len(self._turned):
            self._turned = np.zeros(len(begun), np.bool_)
            self.charges = np.zeros(len(begun), np.bool_)
        self._turned[begun] = False
        self.charges[begun] = False
        self.margin = self.margin_above_reserve(observations, begun)
        must = self._late(observations, distance_m)
        if not self._shuttles:
            must |= distance_m >= thresholds.AT_END * s["length_m"]
        self.charges = np.zeros(len(begun), np.bool_)
        if self._docking is not None:
            energies = self.energies(observations)
            must |= self._docking.must_turn(observations, energies)
            self.margin = self._docking.margin(observations, energies)
            self.charges = self._docking.stops(observations, begun, energies, self._turned | must)
        turns = (self.margin < 0.0) | must
        if self._sees_posts:  # a patrol that turns between posts loses the lap
            turns &= self._may_turn(distance_m)
        final = feature(observations, "returning") >= 1.0
        self._turned = self._turned | (turns & ~self.charges) | final
        return self._turned.copy()

    def drive(self, observations: Observations, homebound: NDArray[np.bool_]) -> NDArray[Any]:
        """Actions at the rule's pace for missions that go on or, where `homebound` of shape (n,),
        head home."""
        return self._pace.act(self._known, observations, homebound, self.charges)

    def _may_turn(self, distance_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Where a patrol may turn back for good, shape (n,)."""
        return np.asarray(distance_m <= 0.0)

    @abstractmethod
    def margin_above_reserve(
        self, observations: Observations, begun: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Energy beyond that of going on to the next chance to turn and then home, shape (n,).

        As a share of the usable energy; the robot turns back when it is negative. Arguments as in
        `act`.
        """

    def energies(self, observations: Observations) -> Energies:
        """Energies of the last decision, for the docks."""
        spare = self.margin + self.cost_of_going_on(observations)
        return Energies(
            margin=self.margin,
            spare=spare,
            home=feature(observations, "home_cost"),
            round_trip=self.round_trip(observations),
        )

    def round_trip(self, observations: Observations) -> NDArray[np.float64]:
        """Energy of a round at cruise by Eq. 7, with the consumption so far, a share of the usable
        energy."""
        sine = _mean_sine(observations)
        out_and_back = self._share_per_m(sine) + self._share_per_m(-sine)
        by_file = 0.5 * self._round_m * out_and_back + self._extra_share
        return (1.0 + feature(observations, "consumption")) * by_file

    def charged(self, observations: Observations) -> Any:
        """Energy that chargers have supplied so far, a share of the usable energy; 0 without
        docks."""
        if self._docking is None:
            return 0.0
        return feature(observations, "charged")

    def home_cost_on_average(self, observations: Observations) -> NDArray[np.float64]:
        """Energy to get home by Eq. 8 at the average grade, a share of the usable energy, shape
        (n,)."""
        distance_m = feature(observations, "distance") * self._reach_m
        sine = -_mean_sine(observations)
        return np.asarray(distance_m * self._share_per_m(sine) + self._share_kept(sine))

    def kept_on_average(self, observations: Observations) -> NDArray[np.float64]:
        """Energy that stays in the battery below its cut-off at the average grade, up or down, a
        share of the usable energy, shape (n,)."""
        sine = _mean_sine(observations)
        return np.asarray(np.maximum(self._share_kept(sine), self._share_kept(-sine)))

    def cost_of_going_on(self, observations: Observations) -> NDArray[np.float64]:
        """Energy of going on to the next chance to turn, and back, by Eq. 7 at the average grade,
        as above, shape (n,).

        The next chance is a decision or two away; on a patrol it is a lap with its pit stops.
        """
        sine = _mean_sine(observations)
        out_and_back = self._share_per_m(sine) + self._share_per_m(-sine)
        return self._outward_m * out_and_back + self._extra_share

    def _share_per_m(self, sine: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(sine, self._sines, self._shares_per_m)

    def _share_kept(self, sine: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.interp(sine, self._sines, self._shares_kept))

    def _late(
        self, observations: Observations, distance_m: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        s = self._known.shared[0]
        left_s = (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        needed_s = thresholds.HOME_TIME * (distance_m / s["cruise_mps"] + self._round_s)
        return np.asarray(left_s < needed_s)


class BelievingRule(TurnBackRule):
    """Estimates the energy of the way home from measurements, with a reserve of k of its standard
    deviations.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        deviations: Reserve in standard deviations k, 0 or above.

    Attributes:
        outlook: Belief at the last decision.
    """

    def __init__(self, known: Known, pace: Pace, deviations: float) -> None:
        super().__init__(known, pace)
        self.deviations = deviations
        self.outlook: Outlook

    def margin_above_reserve(
        self, observations: Observations, begun: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Energy beyond the estimated way home and the reserve, see
        `TurnBackRule.margin_above_reserve`."""
        self.outlook = self.look(observations, begun)
        return self.margin_above_reserve_by(self.outlook)

    def margin_above_reserve_by(self, outlook: Outlook) -> NDArray[np.float64]:
        """The same, from an outlook."""
        return (
            outlook.energy_left
            - outlook.home
            - outlook.onwards
            - self.deviations * outlook.deviation
        )

    def energies(self, observations: Observations) -> Energies:
        """Energies of the last decision, see `TurnBackRule.energies`."""
        spare = self.margin + self.outlook.onwards
        return Energies(
            margin=self.margin,
            spare=spare,
            home=self.outlook.home,
            round_trip=self.round_trip(observations),
        )

    @abstractmethod
    def look(self, observations: Observations, begun: NDArray[np.bool_]) -> Outlook:
        """Update the belief and return it. Arguments as in `act`; a repeated decision counts
        once."""


def sees_posts(known: Known) -> bool:
    """Whether arrivals at a patrol's posts are observable: pit stops shorter than a decision may be
    missed."""
    s = known.shared[0]
    return bool(s["shuttles"] and s["pit_stop_s"] >= s["decision_s"])


def _mean_sine(observations: Observations) -> NDArray[np.float64]:
    return SINE_UNIT * feature(observations, "grade_mean")
