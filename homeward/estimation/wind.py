"""The wind that a hypothesis expects on a way, and the effect of its square on the energy.

Symmetric 2x2 matrices over the wind are triples: east, both, north.
"""

from __future__ import annotations

from typing import Any

from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH
from homeward.physics.jit import inline


@inline
def gust_variance(prior: Any, mean: Any, covariance: Any) -> float:
    """Variance of each component of the gusts, (m/s)^2: that of a share of the mean wind, whose
    square is expected."""
    mean_square = (
        mean[EAST] * mean[EAST]
        + mean[NORTH] * mean[NORTH]
        + covariance[EAST, EAST]
        + covariance[NORTH, NORTH]
    )
    return float(prior.gust_share * prior.gust_share * mean_square)


@inline
def covariance_of_wind(
    covariance: Any, gust_share: float, gust_variance_to_come: float
) -> tuple[float, float, float]:
    """Covariance of the wind on a way, (m/s)^2.

    Args:
        covariance: Covariance of the states.
        gust_share: Share of the present gusts that remains on the way.
        gust_variance_to_come: Variance of either component of the gusts to come.
    """
    of_gust_east = 2.0 * covariance[EAST, GUST_EAST] + gust_share * covariance[GUST_EAST, GUST_EAST]
    of_gust_north = (
        2.0 * covariance[NORTH, GUST_NORTH] + gust_share * covariance[GUST_NORTH, GUST_NORTH]
    )
    of_gusts = (
        covariance[EAST, GUST_NORTH]
        + covariance[GUST_EAST, NORTH]
        + gust_share * covariance[GUST_EAST, GUST_NORTH]
    )
    east = covariance[EAST, EAST] + gust_share * of_gust_east
    east_north = covariance[EAST, NORTH] + gust_share * of_gusts
    north = covariance[NORTH, NORTH] + gust_share * of_gust_north
    return east + gust_variance_to_come, east_north, north + gust_variance_to_come


@inline
def quadratic_cumulants(hessian: Any, wind_covariance: Any) -> tuple[float, float, float]:
    """First three cumulants of half of w^T H w, where w is the deviation of the wind from its mean.

    With M = H W they are tr(M) / 2, tr(M^2) / 2 and tr(M^3) (Mathai and Provost, Quadratic Forms in
    Random Variables, 1992).

    Args:
        hessian: Second derivatives H of the energy.
        wind_covariance: Covariance W of the wind.
    """
    h_ee = hessian[0]
    h_en = hessian[1]
    h_nn = hessian[2]
    w_ee = wind_covariance[0]
    w_en = wind_covariance[1]
    w_nn = wind_covariance[2]
    m_ee = h_ee * w_ee + h_en * w_en
    m_en = h_ee * w_en + h_en * w_nn
    m_ne = h_en * w_ee + h_nn * w_en
    m_nn = h_en * w_en + h_nn * w_nn
    trace = m_ee + m_nn
    determinant = m_ee * m_nn - m_en * m_ne
    trace_of_square = trace * trace - 2.0 * determinant
    trace_of_cube = trace * (trace_of_square - determinant)
    return 0.5 * trace, 0.5 * trace_of_square, trace_of_cube
