"""Noise of a channel, estimated from the channel itself, and the smoothed channel.

A channel is modelled as a smooth signal plus white noise: differences of the signal are normal, and
their variance over that of the noise maximises the marginal likelihood (Whittaker, 1922; Wecker &
Ansley, 1983). The smoothed channel is its expectation given the recording. A regression on that is
not attenuated, as one on the noisy channel is (regression calibration: Carroll et al., Measurement
Error in Nonlinear Models, 2006).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded, solve_banded
from scipy.optimize import minimize_scalar

from homeward.logs.channels import Array

# of the noise's variance over that of the differences; chosen: from no noise to noise only
_LOG_RATIOS = (-12.0, 26.0)
# of the logarithm of a ratio of variances; chosen: 5 %, which hardly changes the values
_PRECISE = 0.05
_SWEEPS = 8  # of expectation maximisation; chosen: bounds the time
_FREEDOM = 1.0  # degrees of freedom of Student's t: jumps of any size
_SMOOTHED_AT_ONCE = 50_000  # samples; chosen: the noise is then known within 1 %, 1 / sqrt(2 n)
_STENCILS = {1: (-1.0, 1.0), 2: (1.0, -2.0, 1.0)}  # of differences, by their order
# of the posterior: its variance, averaged over thousands of samples, is known within a few per cent
_DRAWS = 16


@dataclass(frozen=True)
class Smoothed:
    """A channel without its noise; arrays of shape (n,).

    `draws` of shape (draws, m) are draws of the posterior about its mean, over the first m samples.
    """

    values: Array
    noise: float  # standard deviation of one sample of weight 1
    draws: Array


class _Fit(NamedTuple):
    """A fit at some ratio of variances."""

    factor: Array  # Cholesky factor of the normal equations, upper banded form
    variance: float  # of the noise
    minus_two_log_likelihood: float


class _Likeliest(NamedTuple):
    """The fit at the maximum-likelihood ratio of variances."""

    log_ratio: float  # logarithm of the noise's variance over that of the differences
    factor: Array  # Cholesky factor of the normal equations, upper banded form
    noise: float  # standard deviation


def white_noise(values: Array) -> float:
    """Standard deviation of the white noise of an evenly spaced channel, from its second
    differences.

    Their median is robust to occasional changes of level or slope of the signal (Gasser, Sroka &
    Jennen-Steinmetz, 1986); zeros are left out, as a sensor shows rest without noise.

    >>> rng = np.random.default_rng(0)
    >>> round(white_noise(np.repeat([0.0, 3.0, 1.0], 1000) + 0.1 * rng.normal(size=3000)), 2)
    0.1
    """
    not_zero = values[1:-1] != 0.0
    magnitudes = np.abs(np.diff(values, 2)[not_zero])
    if len(magnitudes) == 0:
        return 0.0
    # A normal distribution has a standard deviation of 1.4826 times the median magnitude. The
    # squares of 1, -2, 1 add up to 6.
    return float(1.4826 * np.median(magnitudes) / np.sqrt(6.0))


def smoothed(
    values: Array,
    order: int,
    weight: Array | None = None,
    breaks: Array | None = None,
    jumps: bool = False,
    noise: float | None = None,
) -> Smoothed:
    """Separate an evenly spaced channel from white noise.

    Args:
        values: The channel, shape (n,); any number where the weight is 0.
        order: Of the differences that are normal: 1 for a channel whose level wanders, 2 for one
            whose slope does.
        weight: Inverse variance of the noise of each sample, relative; 1 by default.
        breaks: 0 where a difference that starts there may be large, 1 elsewhere, shape (n -
            order,).
        jumps: Whether differences have Student's t distribution instead, as those of a channel that
            mostly keeps its level (by expectation maximisation: Lange, Little & Taylor, 1989).
        noise: Standard deviation of the noise, where it is known.

    >>> rng = np.random.default_rng(0)
    >>> wave = np.sin(np.arange(2000) / 40.0)
    >>> smooth = smoothed(wave + 0.1 * rng.normal(size=2000), order=2)
    >>> round(smooth.noise, 2), round(float(np.std(smooth.values - wave)), 2), round(float(smooth.draws.std()), 2)
    (0.1, 0.02, 0.02)
    """
    if weight is None:
        weight = np.ones(len(values))
    stiffness = np.ones(len(values) - order) if breaks is None else breaks
    # Of a long channel the head shows noise and ratio of variances.
    head = values[:_SMOOTHED_AT_ONCE]
    head_weight = weight[:_SMOOTHED_AT_ONCE]
    differences = slice(0, _SMOOTHED_AT_ONCE - order)
    grid = np.arange(*_LOG_RATIOS, 2.0)
    likeliest = _likeliest(head, head_weight, stiffness[differences], order, grid, noise)
    if jumps:
        for _ in range(_SWEEPS):
            stiffness = _stiffness(
                values, weight, stiffness, order, likeliest.log_ratio, likeliest.noise
            )
            grid = np.clip(likeliest.log_ratio + np.arange(-2.0, 4.0, 2.0), *_LOG_RATIOS)
            likeliest = _likeliest(head, head_weight, stiffness[differences], order, grid, noise)
    draws = _draws(likeliest.factor, order, len(head), likeliest.noise)
    penalty = _penalty(stiffness, order, len(values))
    _, expected = _solved(values, weight, penalty, likeliest.log_ratio)
    return Smoothed(values=expected, noise=likeliest.noise, draws=draws)


def _likeliest(
    values: Array, weight: Array, stiffness: Array, order: int, grid: Array, noise: float | None
) -> _Likeliest:
    """The maximum-likelihood fit: the likeliest ratio of a grid, of step 2, refined by a search
    around it."""
    penalty = _penalty(stiffness, order, len(values))

    def minus_two_log_likelihood(log_ratio: float) -> float:
        return _fit(values, weight, penalty, stiffness, log_ratio, noise).minus_two_log_likelihood

    on_grid = [minus_two_log_likelihood(log_ratio) for log_ratio in grid]
    start = float(grid[np.argmin(on_grid)])
    lowest, highest = _LOG_RATIOS
    search = minimize_scalar(
        minus_two_log_likelihood,
        bounds=(max(start - 2.0, lowest), min(start + 2.0, highest)),
        method="bounded",
        options={"xatol": _PRECISE},
    )
    log_ratio = float(search.x)
    fit = _fit(values, weight, penalty, stiffness, log_ratio, noise)
    return _Likeliest(log_ratio, fit.factor, noise=float(np.sqrt(fit.variance)))


def _stiffness(
    values: Array, weight: Array, stiffness: Array, order: int, log_ratio: float, noise: float
) -> Array:
    """Expected inverse variance of each difference, relative, if differences are from Student's t
    distribution."""
    penalty = _penalty(stiffness, order, len(values))
    factor, smooth = _solved(values, weight, penalty, log_ratio)
    drawn = min(len(values), _SMOOTHED_AT_ONCE)
    draws = _draws(factor[:, -drawn:], order, drawn, noise)
    spread = np.mean(np.diff(draws, order, axis=1) ** 2, axis=0)
    if drawn < len(values):
        spread = np.full(len(stiffness), spread.mean())
    # Expected squared difference over the variance of differences, which is noise^2 /
    # exp(log_ratio).
    expected = np.diff(smooth, order) ** 2 + spread
    squared = expected * np.exp(log_ratio) / max(noise**2, 1e-300)
    return np.where(stiffness > 0.0, (_FREEDOM + 1.0) / (_FREEDOM + squared), 0.0)


def _draws(factor: Array, order: int, count: int, noise: float) -> Array:
    """Draws of the posterior about its mean, shape (draws, count); the same for the same
    channel."""
    normal = np.random.default_rng(0).standard_normal((count, _DRAWS))
    return np.asarray(noise * solve_banded((0, order), factor, normal).T)


def _penalty(stiffness: Array, order: int, count: int) -> Array:
    """Sum of squared differences, times their stiffness, as a banded matrix, upper form, shape
    (order + 1, n)."""
    stencil = _STENCILS[order]
    bands = np.zeros((order + 1, count))
    for row in range(order + 1):
        for column in range(row, order + 1):
            band = bands[order - (column - row)]
            band[column : column + len(stiffness)] += stencil[row] * stencil[column] * stiffness
    return bands


def _solved(values: Array, weight: Array, penalty: Array, log_ratio: float) -> tuple[Array, Array]:
    """Cholesky factor of the normal equations at a ratio of variances, and the smoothed channel."""
    bands = np.exp(log_ratio) * penalty
    # The last band is the diagonal; a trace of weight keeps it positive definite where samples have
    # none.
    bands[-1] += weight + 1e-12 * float(weight.max())
    factor = cholesky_banded(bands)
    return factor, cho_solve_banded((factor, False), weight * values)


def _fit(
    values: Array,
    weight: Array,
    penalty: Array,
    stiffness: Array,
    log_ratio: float,
    noise: float | None,
) -> _Fit:
    """The fit at a ratio of variances; its likelihood is marginal, as the smooth signal is
    integrated out.

    The determinants of the normal equations and of the stiffness are its own, that of the weights
    is constant.
    """
    order = len(penalty) - 1
    factor, smooth = _solved(values, weight, penalty, log_ratio)
    # Summed from the differences: by the quadratic form, a difference of large sums, it could be
    # rounded below zero.
    misfit = weight @ (values - smooth) ** 2
    differences = np.diff(smooth, order)
    bending = np.exp(log_ratio) * stiffness @ differences**2
    squared = max(float(misfit + bending), 1e-300)
    weighted = int((weight > 0.0).sum())
    stiff = stiffness[stiffness > 0.0]
    degrees_of_freedom = max(weighted - (len(values) - len(stiff)), 1)
    variance = squared / degrees_of_freedom if noise is None else noise**2
    log_determinant = 2.0 * float(np.log(factor[-1]).sum())
    minus_two_log_likelihood = (
        degrees_of_freedom * np.log(variance) + squared / variance + log_determinant
    )
    minus_two_log_likelihood -= len(stiff) * log_ratio + float(np.log(stiff).sum())
    return _Fit(factor, variance, minus_two_log_likelihood)
