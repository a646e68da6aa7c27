"""Noise of a channel, estimated from the channel itself, and the smoothed channel.

A channel is modelled as a smooth signal plus white noise: differences of the signal are normal, and their variance over
that of the noise maximises the marginal likelihood (Whittaker, 1922; Wecker & Ansley, 1983). The smoothed channel is
its expectation given the recording. A regression on that is not attenuated, as one on the noisy channel is (regression
calibration: Carroll et al., Measurement Error in Nonlinear Models, 2006).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded, solve_banded
from scipy.optimize import minimize_scalar

from homeward.logs.channels import Array

_LOG_RATIOS = (-12.0, 26.0)  # of the noise's variance over that of the differences; chosen: from no noise to noise only
_PRECISE = 0.05  # of the logarithm of a ratio of variances; chosen: 5 %, which hardly changes the values
_SWEEPS = 8  # of expectation maximisation; chosen: bounds the time
_FREEDOM = 1.0  # degrees of freedom of Student's t: jumps of any size
_SMOOTHED_AT_ONCE = 50_000  # samples; chosen: the noise is then known within 1 %, 1 / sqrt(2 n)
_DRAWS = 16  # of the posterior: its variance, averaged over thousands of samples, is known within a few per cent


@dataclass(frozen=True)
class Smoothed:
    """A channel without its noise; arrays of shape (n,).

    `draws` of shape (draws, m) are draws of the posterior about its mean, over the first m samples.
    """

    values: Array
    noise: float  # standard deviation of one sample of weight 1
    draws: Array


def white_noise(values: Array) -> float:
    """Standard deviation of the white noise of an evenly spaced channel, from its second differences.

    Their median is robust to occasional changes of level or slope of the signal (Gasser, Sroka & Jennen-Steinmetz,
    1986); zeros are left out, as a sensor shows rest without noise.

    >>> rng = np.random.default_rng(0)
    >>> round(white_noise(np.repeat([0.0, 3.0, 1.0], 1000) + 0.1 * rng.normal(size=3000)), 2)
    0.1
    """
    second = np.abs(np.diff(values, 2)[(values[1:-1] != 0.0)])
    return float(1.4826 * np.median(second) / np.sqrt(6.0)) if len(second) else 0.0  # of normal noise


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
        order: Of the differences that are normal: 1 for a channel whose level wanders, 2 for one whose slope does.
        weight: Inverse variance of the noise of each sample, relative; 1 by default.
        breaks: 0 where a difference that starts there may be large, 1 elsewhere, shape (n - order,).
        jumps: Whether differences have Student's t distribution instead, as those of a channel that mostly keeps its
            level (by expectation maximisation: Lange, Little & Taylor, 1989).
        noise: Standard deviation of the noise, where it is known.

    >>> rng = np.random.default_rng(0)
    >>> wave = np.sin(np.arange(2000) / 40.0)
    >>> found = smoothed(wave + 0.1 * rng.normal(size=2000), order=2)
    >>> round(found.noise, 2), round(float(np.std(found.values - wave)), 2), round(float(found.draws.std()), 2)
    (0.1, 0.02, 0.02)
    """
    weight = np.ones(len(values)) if weight is None else weight
    stiffness = np.ones(len(values) - order) if breaks is None else breaks
    part = slice(0, _SMOOTHED_AT_ONCE)
    head, its_weight, its_stiffness = values[part], weight[part], stiffness[: _SMOOTHED_AT_ONCE - order]
    best, factor, found = _likeliest(head, its_weight, its_stiffness, order, np.arange(*_LOG_RATIOS, 2.0), noise)
    for _ in range(_SWEEPS if jumps else 0):
        stiffness = _stiffness(values, weight, stiffness, order, best, found)
        its_stiffness = stiffness[: _SMOOTHED_AT_ONCE - order]
        grid = np.clip(best + np.arange(-2.0, 4.0, 2.0), *_LOG_RATIOS)
        best, factor, found = _likeliest(head, its_weight, its_stiffness, order, grid, noise)
    draws = _draws(factor, order, len(head), found)
    _, expected = _solved(values, weight, _penalty(stiffness, order, len(values)), best)
    return Smoothed(expected, found, draws)


def _likeliest(
    values: Array, weight: Array, stiffness: Array, order: int, grid: Array, noise: float | None
) -> tuple[float, Array, float]:
    """Maximum-likelihood log ratio of variances, its Cholesky factor, and the noise's standard deviation."""
    roughness = _penalty(stiffness, order, len(values))

    def negative_log_likelihood(log_ratio: float) -> float:
        return _fit(values, weight, roughness, stiffness, log_ratio, noise)[2]

    start = float(grid[np.argmin([negative_log_likelihood(one) for one in grid])])
    low, high = max(start - 2.0, _LOG_RATIOS[0]), min(start + 2.0, _LOG_RATIOS[1])
    found = minimize_scalar(negative_log_likelihood, bounds=(low, high), method="bounded", options={"xatol": _PRECISE})
    best = float(found.x)
    factor, variance, _ = _fit(values, weight, roughness, stiffness, best, noise)
    return best, factor, float(np.sqrt(variance))


def _stiffness(values: Array, weight: Array, stiffness: Array, order: int, log_ratio: float, noise: float) -> Array:
    """Expected inverse variance of each difference, relative, if differences are from Student's t distribution."""
    factor, smooth = _solved(values, weight, _penalty(stiffness, order, len(values)), log_ratio)
    drawn = min(len(values), _SMOOTHED_AT_ONCE)
    spread = np.mean(np.diff(_draws(factor[:, -drawn:], order, drawn, noise), order, axis=1) ** 2, axis=0)
    if drawn < len(values):
        spread = np.full(len(stiffness), spread.mean())
    squared = (np.diff(smooth, order) ** 2 + spread) * np.exp(log_ratio) / max(noise**2, 1e-300)
    return np.where(stiffness > 0.0, (_FREEDOM + 1.0) / (_FREEDOM + squared), 0.0)


def _draws(factor: Array, order: int, count: int, noise: float) -> Array:
    normal = np.random.default_rng(0).standard_normal((count, _DRAWS))
    return np.asarray(noise * solve_banded((0, order), factor, normal).T)


def _penalty(breaks: Array, order: int, count: int) -> Array:
    """Sum of squared differences as a banded matrix, upper form, shape (order + 1, n)."""
    stencil = np.array([-1.0, 1.0]) if order == 1 else np.array([1.0, -2.0, 1.0])
    bands = np.zeros((order + 1, count))
    for one in range(order + 1):
        for other in range(one, order + 1):
            bands[order - (other - one), other : other + len(breaks)] += stencil[one] * stencil[other] * breaks
    return bands


def _solved(values: Array, weight: Array, roughness: Array, log_ratio: float) -> tuple[Array, Array]:
    """Cholesky factor of the normal equations at a ratio of variances, and the smoothed channel."""
    bands = np.exp(log_ratio) * roughness
    bands[-1] += weight + 1e-12 * float(weight.max())
    factor = cholesky_banded(bands)
    return factor, cho_solve_banded((factor, False), weight * values)


def _fit(
    values: Array, weight: Array, roughness: Array, stiffness: Array, log_ratio: float, noise: float | None
) -> tuple[Array, float, float]:
    """Cholesky factor, variance of the noise, and minus twice the log likelihood, at a ratio of variances."""
    factor, smooth = _solved(values, weight, roughness, log_ratio)
    rough = np.diff(smooth, len(roughness) - 1) ** 2  # a difference of large sums could be rounded to less than zero
    squared = max(float(weight @ (values - smooth) ** 2 + np.exp(log_ratio) * stiffness @ rough), 1e-300)
    known, bound = int((weight > 0.0).sum()), stiffness[stiffness > 0.0]
    free = max(known - (len(values) - len(bound)), 1)
    variance = squared / free if noise is None else noise**2
    minus_two_log_likelihood = free * np.log(variance) + squared / variance + 2.0 * float(np.log(factor[-1]).sum())
    minus_two_log_likelihood -= len(bound) * log_ratio + float(np.log(bound).sum())
    return factor, variance, minus_two_log_likelihood
