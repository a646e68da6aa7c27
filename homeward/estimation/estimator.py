"""Estimates of robots side by side: readings in, a distribution of the robot, the wind and the way home out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.estimation.drive import Vehicle
from homeward.estimation.filter import HYPOTHESIS_DTYPE, PLACE_DTYPE, ROBOT_DTYPE, update
from homeward.estimation.margin import MARGIN_DTYPE, PLAN_DTYPE, WAY_DTYPE, judge
from homeward.estimation.prior import HYPOTHESES, PER_CAPACITY, USED, Prior, first_hypotheses
from homeward.estimation.relocation import relocate

NO_WAYS = np.zeros(0, WAY_DTYPE)
"""No way home but back over the way out."""


class Margin(NamedTuple):
    """What plans leave.

    Attributes:
        total: `MARGIN_DTYPE`, shape (n,).
        weight: Of each hypothesis about the wind, shape (n, hypotheses), as the next two.
        mean_j: Of the margin, by that hypothesis, metered J.
        sd_j: Standard deviation of the same.
    """

    total: NDArray[np.void]
    weight: NDArray[np.float64]
    mean_j: NDArray[np.float64]
    sd_j: NDArray[np.float64]


class StateEstimate(NamedTuple):
    """Mean and covariance over all hypotheses.

    Attributes:
        mean: Of the states of `homeward.estimation.prior`, shape (n, STATES).
        covariance: Shape (n, STATES, STATES).
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]


class Estimator:
    """Estimates the parameters, the wind and the way home of robots online.

    All energies that it answers are metered: what the robot's own power meter would show, less its offset, so that its
    gain cancels between energy left and way home.

    Args:
        vehicle: The robot's own model.
        prior: What is known before anything was driven.
        places: Number of places of the route.
        count: Number of robots n.

    Attributes:
        state: Everything that is known of each robot, one record each, shape (n,): a copy of it can be put back.
    """

    def __init__(self, vehicle: Vehicle, prior: Prior, places: int, count: int) -> None:
        self.vehicle, self.prior = vehicle, prior
        self.state = np.zeros(
            count,
            np.dtype(
                [
                    ("robot", ROBOT_DTYPE),
                    ("hypotheses", HYPOTHESIS_DTYPE, (HYPOTHESES,)),
                    ("places", PLACE_DTYPE, (places,)),
                    ("rollings", np.float64, (HYPOTHESES, places)),
                ]
            ),
        )
        self.begin(np.ones(count, np.bool_), np.zeros(count), np.zeros(count))

    def begin(
        self, mask: NDArray[np.bool_], wind_east_mps: NDArray[np.float64], wind_north_mps: NDArray[np.float64]
    ) -> None:
        """Begin new missions at home with a full battery.

        Args:
            mask: Which robots begin, shape (n,).
            wind_east_mps: Forecast of the wind, towards where it comes from, shape (n,).
            wind_north_mps: The same to the north.
        """
        forecast_mps = np.stack((wind_east_mps, wind_north_mps), axis=-1)[mask]
        mean, covariance, probability = first_hypotheses(self.prior, self.vehicle.full_j, forecast_mps)
        new = np.zeros(len(forecast_mps), self.state.dtype)
        new["robot"]["soc"], new["robot"]["soc_start"] = np.nan, 1.0
        new["hypotheses"]["mean"], new["hypotheses"]["covariance"] = mean, covariance
        new["hypotheses"]["gust_s"] = self.prior.gust_s
        with np.errstate(divide="ignore"):
            new["hypotheses"]["log_weight"] = np.log(probability)
        self.state[mask] = new

    def update(self, readings: NDArray[np.void], mask: NDArray[np.bool_]) -> None:
        """Take in readings; one that is not later than the last one is left out.

        Args:
            readings: `READING_DTYPE`, shape (n,).
            mask: Which robots have one, shape (n,).
        """
        s = self.state
        update(self.vehicle, self.prior, mask, readings, s["robot"], s["hypotheses"], s["places"], s["rollings"])

    def relocate(self, position_m: float) -> None:
        """Robots are elsewhere on their way home than they drove to: one found a short cut, or home has moved.

        Args:
            position_m: Way home from now on, m, over ground already driven or, where it is longer, as that here.
        """
        s = self.state
        relocate(self.vehicle, s["robot"], s["hypotheses"], s["places"], s["rollings"], position_m)

    def recharge(self, soc: float, soc_sd: float) -> None:
        """Robots have another battery, or the same with another charge: nothing that was learned of it holds.

        Args:
            soc: State of charge, a share.
            soc_sd: Standard deviation of its error.
        """
        robot, h = self.state["robot"], self.state["hypotheses"]
        mean, covariance, _ = first_hypotheses(self.prior, self.vehicle.full_j, np.zeros((1, 2)))
        per = mean[0, 0, PER_CAPACITY]
        for state in (USED, PER_CAPACITY):
            h["covariance"][..., state, :] = h["covariance"][..., :, state] = 0.0
        h["mean"][..., PER_CAPACITY], h["mean"][..., USED] = per, 0.0
        h["covariance"][..., PER_CAPACITY, PER_CAPACITY] = covariance[0, 0, PER_CAPACITY, PER_CAPACITY]
        h["covariance"][..., USED, USED] = (soc_sd / per) ** 2
        robot["soc_start"], robot["soc"] = soc, np.nan
        robot["lag"] = robot["soc_since"] = robot["soc_taken"] = 0.0

    def mean(self) -> NDArray[np.float64]:
        """Mean of the states over all hypotheses, see `StateEstimate`."""
        h = self.state["hypotheses"]
        return np.asarray(np.einsum("nk,nka->na", np.exp(h["log_weight"]), h["mean"]))

    def estimate(self) -> StateEstimate:
        """Parameters and wind."""
        h = self.state["hypotheses"]
        weight = np.exp(h["log_weight"])
        mean = self.mean()
        apart = h["mean"] - mean[:, None]
        covariance = np.einsum("nk,nkab->nab", weight, h["covariance"])
        return StateEstimate(mean, covariance + np.einsum("nk,nka,nkb->nab", weight, apart, apart))

    def plans(self, home_cost_j: NDArray[np.float64], home_mps: float | None = None) -> NDArray[np.void]:
        """Plans of heading home now, `PLAN_DTYPE`, shape (n,), to be changed as one likes.

        Args:
            home_cost_j: From here home by the robot's own model, shape (n,).
            home_mps: How fast; cruise if left out.
        """
        plans = np.zeros(len(self.state), PLAN_DTYPE)
        plans["home_cost_j"], plans["sine"] = home_cost_j, np.nan
        plans["home_mps"] = plans["speed_mps"] = self.vehicle.cruise_mps if home_mps is None else home_mps
        return plans

    def margin(self, plans: NDArray[np.void], risk: float, ways: NDArray[np.void] = NO_WAYS) -> Margin:
        """Distribution of what plans leave: energy left, less driving on and then home.

        Args:
            plans: `PLAN_DTYPE`, shape (n,).
            risk: Probability that a margin is below its `margin_low_j`; 0 leaves that out, NaN, and takes less time.
            ways: `WAY_DTYPE`, shape (m,): the way home of plans that lead home elsewhere.
        """
        s = self.state
        total, each = np.zeros(len(s), MARGIN_DTYPE), np.zeros((len(s), HYPOTHESES, 4))
        judge(
            self.vehicle, self.prior, plans, ways, risk, s["robot"], s["hypotheses"], s["places"], s["rollings"], total,
            each,
        )  # fmt: skip
        return Margin(total, each[..., 0], each[..., 1], each[..., 2])
