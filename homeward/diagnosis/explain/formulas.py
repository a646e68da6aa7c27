"""Candidates for an empirical term: what drives the load times at most two dimensionless groups of the channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.explain.dimensionless import Factor, factors
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.physics import ancillary_power
from homeward.physics.model import GRAVITY_MPS2

Candidate = tuple[int, int, int]
"""A base and two factors, by their places in the library."""


@dataclass(frozen=True)
class Base:
    """What the dimensionless groups multiply, shape (windows,), and which of them it may be multiplied with."""

    symbol: str
    unit: str
    values: Array
    allowed: NDArray[np.bool_]  # (factors,)


@dataclass(frozen=True)
class Library:
    """All candidates: each base times two of the factors, of which the first is 1."""

    bases: tuple[Base, ...]
    factors: tuple[Factor, ...]
    values: Array  # (windows, factors)

    def pairs(self, base: Base) -> NDArray[np.bool_]:
        """Which products of two factors are candidates, shape (factors, factors), each once."""
        family = np.array([one.family for one in self.factors])
        differ = family[:, None] != family[None, :]
        differ[0, 0] = True
        once: NDArray[np.bool_] = np.triu(differ & base.allowed[:, None] & base.allowed[None, :])
        return once

    def cost(self) -> list[Array]:
        """What the search for a candidate costs in BIC: the log of the number of candidates that are as simple."""
        plain = np.zeros((len(self.factors),) * 2, dtype=np.intp)
        plain[0, 1:] = 1
        plain[1:, 1:] = 2
        counts = np.cumsum([sum(int((self.pairs(b) & (plain == n)).sum()) for b in self.bases) for n in range(3)])
        price: Array = 2.0 * np.log(counts)[plain]
        return [np.where(self.pairs(base), price, np.inf) for base in self.bases]

    def column(self, where: Candidate) -> Array:
        """Values of one candidate, shape (windows,)."""
        base, first, second = where
        column: Array = self.bases[base].values * self.values[:, first] * self.values[:, second]
        return column

    def columns(self, chosen: Sequence[Candidate]) -> Array:
        """Values of some candidates, shape (windows, chosen)."""
        columns = np.empty((len(self.values), len(chosen)))
        for index, one in enumerate(chosen):
            columns[:, index] = self.column(one)
        return columns

    def text(self, where: Candidate) -> str:
        """One candidate as a formula."""
        base, first, second = where
        symbols = [self.bases[base].symbol, self.factors[first].text, self.factors[second].text]
        return " ".join(symbol for symbol in symbols if symbol)

    @property
    def everything(self) -> Array:
        """Bases and factors side by side."""
        return np.column_stack([*(base.values for base in self.bases), self.values])


def candidates(fit: Fitted, runs: Runs) -> Library:
    """Every candidate that the channels of these runs allow."""
    robot = fit.parameters.nominal
    found = factors(runs, robot)
    values = np.column_stack([one.values for one in found])
    speeds = np.array([one.family == "speed" for one in found])
    slow = np.array([one.text in ("[v > 0]", "(v / v_max)^0.5") for one in found])
    moving = np.array([one.text == "[v > 0]" for one in found])
    if runs.unit == "A":
        # Current is a force: the load is what the motors draw beyond their current at rest.
        load = np.maximum(fit.predicted - fit.theta[0], 0.0)
        return Library(
            (Base("", "A", np.ones(len(load)), ~np.zeros(len(found), bool)), Base("I_drive", "1", load, ~moving)),
            found,
            values,
        )
    weight_w = robot.mass_kg * GRAVITY_MPS2 * np.abs(runs.context["speed_mps"])
    standing = ancillary_power(fit.robot, runs.context.get("sensing_hz", np.zeros(1)))
    load = np.maximum(fit.predicted - standing, 0.0)
    bases = (
        Base("", "W", np.ones(len(load)), ~speeds | slow),  # with a higher power of v it is a load
        Base("m g v", "1", weight_w, ~moving),
        Base("P_drive", "1", load, ~moving),
    )
    return Library(bases, found, values)
