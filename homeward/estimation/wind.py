"""The wind that a hypothesis expects on a way, and the effect of its square on the energy.

Symmetric 2x2 matrices over the wind are triples: east, both, north.
"""

from __future__ import annotations

from typing import Any

from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH
from homeward.physics.jit import inline


@inline
def gust_variance(prior: Any, x: Any, p: Any) -> float:
    """Variance of each component of the gusts, (m/s)^2."""
    square = x[EAST] * x[EAST] + x[NORTH] * x[NORTH] + p[EAST, EAST] + p[NORTH, NORTH]
    return float(prior.gust_share * prior.gust_share * square)


@inline
def covariance_of_wind(p: Any, stays: float, to_come: float) -> tuple[float, float, float]:
    """Covariance of the wind on a way, (m/s)^2.

    Args:
        p: Covariance of the states.
        stays: Share of the present gusts that remains on the way.
        to_come: Variance of either component of the gusts to come.
    """
    east = p[EAST, EAST] + stays * (2.0 * p[EAST, GUST_EAST] + stays * p[GUST_EAST, GUST_EAST])
    north = p[NORTH, NORTH] + stays * (2.0 * p[NORTH, GUST_NORTH] + stays * p[GUST_NORTH, GUST_NORTH])
    both = p[EAST, GUST_NORTH] + p[GUST_EAST, NORTH] + stays * p[GUST_EAST, GUST_NORTH]
    return east + to_come, p[EAST, NORTH] + stays * both, north + to_come


@inline
def curvature(bend: Any, wind: Any) -> tuple[float, float, float]:
    """First three cumulants of a quadratic form of the wind about its mean.

    Args:
        bend: Second derivatives of the energy.
        wind: Covariance of the wind.
    """
    ee, en = bend[0] * wind[0] + bend[1] * wind[1], bend[0] * wind[1] + bend[1] * wind[2]
    ne, nn = bend[1] * wind[0] + bend[2] * wind[1], bend[1] * wind[1] + bend[2] * wind[2]
    # Half the traces of the product, and the traces of its square and cube.
    trace, determinant = ee + nn, ee * nn - en * ne
    square = trace * trace - 2.0 * determinant
    return 0.5 * trace, 0.5 * square, trace * (square - determinant)
