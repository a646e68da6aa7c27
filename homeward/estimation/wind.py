"""The wind that a hypothesis expects on a way, and the effect of its square on the energy.

Symmetric 2x2 matrices over the wind are triples: east, both, north.
"""

from __future__ import annotations

from typing import Any

from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH
from homeward.physics.jit import inline


@inline
def gust_variance(prior: Any, mean: Any, covariance: Any) -> float:
    """Variance of each component of the gusts, (m/s)^2."""
    square = mean[EAST] * mean[EAST] + mean[NORTH] * mean[NORTH] + covariance[EAST, EAST] + covariance[NORTH, NORTH]
    return float(prior.gust_share * prior.gust_share * square)


@inline
def covariance_of_wind(covariance: Any, gust_share: float, gust_variance_to_come: float) -> tuple[float, float, float]:
    """Covariance of the wind on a way, (m/s)^2.

    Args:
        covariance: Covariance of the states.
        gust_share: Share of the present gusts that remains on the way.
        gust_variance_to_come: Variance of either component of the gusts to come.
    """
    east = covariance[EAST, EAST] + gust_share * (
        2.0 * covariance[EAST, GUST_EAST] + gust_share * covariance[GUST_EAST, GUST_EAST]
    )
    north = covariance[NORTH, NORTH] + gust_share * (
        2.0 * covariance[NORTH, GUST_NORTH] + gust_share * covariance[GUST_NORTH, GUST_NORTH]
    )
    east_north = (
        covariance[EAST, GUST_NORTH] + covariance[GUST_EAST, NORTH] + gust_share * covariance[GUST_EAST, GUST_NORTH]
    )
    return (
        east + gust_variance_to_come,
        covariance[EAST, NORTH] + gust_share * east_north,
        north + gust_variance_to_come,
    )


@inline
def quadratic_cumulants(hessian: Any, wind_covariance: Any) -> tuple[float, float, float]:
    """First three cumulants of a quadratic form of the wind about its mean.

    Args:
        hessian: Second derivatives of the energy.
        wind_covariance: Covariance of the wind.
    """
    ee, en = (
        hessian[0] * wind_covariance[0] + hessian[1] * wind_covariance[1],
        hessian[0] * wind_covariance[1] + hessian[1] * wind_covariance[2],
    )
    ne, nn = (
        hessian[1] * wind_covariance[0] + hessian[2] * wind_covariance[1],
        hessian[1] * wind_covariance[1] + hessian[2] * wind_covariance[2],
    )
    # Half the traces of the product, and the traces of its square and cube.
    trace, determinant = ee + nn, ee * nn - en * ne
    square = trace * trace - 2.0 * determinant
    return 0.5 * trace, 0.5 * square, trace * (square - determinant)
