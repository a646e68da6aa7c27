"""Estimates for robots side by side: from readings to a distribution of the robot, the wind and the
way home."""

from __future__ import annotations

from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.estimation.drive import Vehicle
from homeward.estimation.filter import HYPOTHESIS_DTYPE, PLACE_DTYPE, ROBOT_DTYPE, update
from homeward.estimation.margin import MARGIN_DTYPE, PLAN_DTYPE, WAY_DTYPE, compute_margins
from homeward.estimation.prior import (
    HYPOTHESES,
    PER_CAPACITY,
    SOC_ERROR,
    USED,
    Prior,
    first_hypotheses,
)
from homeward.estimation.relocation import relocate

NO_WAYS = np.zeros(0, WAY_DTYPE)
"""No way home but back along the way out."""


class Margin(NamedTuple):
    """Distribution of the energy that plans leave.

    Attributes:
        total: `MARGIN_DTYPE`, shape (n,).
        weight: Weight of each wind hypothesis, shape (n, hypotheses), like the next three.
        mean_j: Mean of the margin by that hypothesis, J as metered.
        sd_j: Its standard deviation.
        skewness: Its skewness, at most 0.
    """

    total: NDArray[np.void]
    weight: NDArray[np.float64]
    mean_j: NDArray[np.float64]
    sd_j: NDArray[np.float64]
    skewness: NDArray[np.float64]


class StateEstimate(NamedTuple):
    """Mean and covariance over all hypotheses.

    Attributes:
        mean: Mean of the states of `homeward.estimation.prior`, shape (n, STATES).
        covariance: Covariance, shape (n, STATES, STATES).
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]


class Estimator:
    """Estimates the parameters, the wind and the way home of robots online.

    All returned energies are as metered: those that the robot's own power meter would show, without
    its offset. The meter's gain therefore cancels between the energy left and that of the way home.

    Args:
        vehicle: The robot's own model.
        prior: Prior of the mission.
        places: Number of places of the route.
        count: Number of robots n.

    Attributes:
        state: State of the estimator, one record for each robot, shape (n,): it can be copied and
            restored.
    """

    def __init__(self, vehicle: Vehicle, prior: Prior, places: int, count: int) -> None:
        self.vehicle = vehicle
        self.prior = prior
        state_dtype = np.dtype(
            [
                ("robot", ROBOT_DTYPE),
                ("hypotheses", HYPOTHESIS_DTYPE, (HYPOTHESES,)),
                ("places", PLACE_DTYPE, (places,)),
                ("rollings", np.float64, (HYPOTHESES, places)),
            ]
        )
        self.state = np.zeros(count, state_dtype)
        everyone = np.ones(count, np.bool_)
        self.begin(everyone, wind_east_mps=np.zeros(count), wind_north_mps=np.zeros(count))

    def begin(
        self,
        mask: NDArray[np.bool_],
        wind_east_mps: NDArray[np.float64],
        wind_north_mps: NDArray[np.float64],
    ) -> None:
        """Begin new missions at home with a full battery.

        Args:
            mask: Which robots begin, shape (n,).
            wind_east_mps: East component of the forecast wind, towards where it comes from, shape
                (n,).
            wind_north_mps: North component of the same.
        """
        forecast_mps = np.stack((wind_east_mps, wind_north_mps), axis=-1)[mask]
        mean, covariance, probability = first_hypotheses(
            self.prior, self.vehicle.full_j, forecast_mps
        )
        new = np.zeros(len(forecast_mps), self.state.dtype)
        new["robot"]["soc"] = np.nan
        new["robot"]["soc_start"] = 1.0
        hypotheses = new["hypotheses"]
        hypotheses["mean"] = mean
        hypotheses["covariance"] = covariance
        hypotheses["gust_s"] = self.prior.gust_s
        with np.errstate(divide="ignore"):  # a hypothesis may be impossible
            hypotheses["log_weight"] = np.log(probability)
        self.state[mask] = new

    def update(self, readings: NDArray[np.void], mask: NDArray[np.bool_]) -> None:
        """Process readings; one that is not later than the last one is left out.

        Args:
            readings: `READING_DTYPE`, shape (n,).
            mask: Which robots have one, shape (n,).
        """
        state = self.state
        update(
            self.vehicle,
            self.prior,
            mask,
            readings,
            state["robot"],
            state["hypotheses"],
            state["places"],
            state["rollings"],
        )

    def relocate(self, position_m: float) -> None:
        """Move robots to another place on their way home: a short cut was found, or home has moved.

        Args:
            position_m: New length of the way home, m, over ground already driven or, if longer,
                like that here.
        """
        state = self.state
        relocate(
            self.vehicle,
            state["robot"],
            state["hypotheses"],
            state["places"],
            state["rollings"],
            position_m,
        )

    def recharge(self, soc: float, soc_sd: float) -> None:
        """Replace the robots' batteries, or their charge: estimates of the old battery are dropped.

        Args:
            soc: State of charge, 0 to 1.
            soc_sd: Standard deviation of its error.
        """
        robot = self.state["robot"]
        mean = self.state["hypotheses"]["mean"]
        covariance = self.state["hypotheses"]["covariance"]
        first_mean, first_covariance, _ = first_hypotheses(
            self.prior, self.vehicle.full_j, np.zeros((1, 2))
        )
        per_capacity = first_mean[0, 0, PER_CAPACITY]
        for state in (USED, PER_CAPACITY, SOC_ERROR):
            covariance[..., state, :] = 0.0
            covariance[..., :, state] = 0.0
        mean[..., PER_CAPACITY] = per_capacity
        covariance[..., PER_CAPACITY, PER_CAPACITY] = first_covariance[
            0, 0, PER_CAPACITY, PER_CAPACITY
        ]
        # The energy used is that of the new battery; what is not known of its charge is not known
        # of that.
        mean[..., USED] = 0.0
        covariance[..., USED, USED] = (soc_sd / per_capacity) ** 2
        mean[..., SOC_ERROR] = 0.0
        covariance[..., SOC_ERROR, SOC_ERROR] = self.prior.soc_error**2
        robot["soc_start"] = soc
        robot["soc"] = np.nan
        robot["lag"] = 0.0
        robot["soc_since"] = 0.0
        robot["soc_taken"] = 0.0

    def mean(self) -> NDArray[np.float64]:
        """Mean of the states over all hypotheses, see `StateEstimate`."""
        hypotheses = self.state["hypotheses"]
        weights = np.exp(hypotheses["log_weight"])
        return np.asarray(np.einsum("nk,nka->na", weights, hypotheses["mean"]))

    def estimate(self) -> StateEstimate:
        """Parameters and wind: moments of the mixture of all hypotheses."""
        hypotheses = self.state["hypotheses"]
        weights = np.exp(hypotheses["log_weight"])
        mean = self.mean()
        deviations = hypotheses["mean"] - mean[:, None]
        within = np.einsum("nk,nkab->nab", weights, hypotheses["covariance"])
        between = np.einsum("nk,nka,nkb->nab", weights, deviations, deviations)
        return StateEstimate(mean, within + between)

    def plans(
        self, home_cost_j: NDArray[np.float64], home_mps: float | None = None
    ) -> NDArray[np.void]:
        """Plans of heading home now, `PLAN_DTYPE`, shape (n,), which may be modified.

        Args:
            home_cost_j: Energy from here home by the robot's own model, J, shape (n,).
            home_mps: Speed home, m/s; by default cruise.
        """
        if home_mps is None:
            home_mps = self.vehicle.cruise_mps
        plans = np.zeros(len(self.state), PLAN_DTYPE)
        plans["home_cost_j"] = home_cost_j
        plans["sine"] = np.nan
        plans["home_mps"] = home_mps
        plans["speed_mps"] = home_mps
        return plans

    def margin(
        self, plans: NDArray[np.void], risk: float, ways: NDArray[np.void] = NO_WAYS
    ) -> Margin:
        """Distribution of the energy that plans leave: energy left, less driving on and then home.

        Args:
            plans: `PLAN_DTYPE`, shape (n,).
            risk: Probability that a margin is below its `margin_low_j`; with 0 that is NaN, which
                saves time.
            ways: `WAY_DTYPE`, shape (m,): the way home of plans that do not go back along the way
                out.
        """
        state = self.state
        count = len(state)
        margins = np.zeros(count, MARGIN_DTYPE)
        mixtures = np.zeros((count, HYPOTHESES, 4))
        normal_quantile = -np.inf
        if risk > 0.0:
            normal_quantile = NormalDist().inv_cdf(risk)
        compute_margins(
            self.vehicle,
            self.prior,
            plans,
            ways,
            risk,
            normal_quantile,
            state["robot"],
            state["hypotheses"],
            state["places"],
            state["rollings"],
            margins,
            mixtures,
        )
        return Margin(
            total=margins,
            weight=mixtures[..., 0],
            mean_j=mixtures[..., 1],
            sd_j=mixtures[..., 2],
            skewness=mixtures[..., 3],
        )
