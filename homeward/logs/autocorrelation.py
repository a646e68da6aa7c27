"""Statistics of series whose windows depend on those before: autocorrelation time, noise,
innovations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homeward.logs.channels import Array, Index
from homeward.logs.thresholds import LONGEST_LAG, MOST_CORRELATED, UNCORRELATED

# windows from which the next is predicted: longer than a change of a load is refined in the
# diagnosis
_PAST = 5


def correlation_windows(residual: Array, run: Index) -> float:
    """Integrated autocorrelation time of residuals, in windows, summed to the first lag without
    correlation.

    >>> rng = np.random.default_rng(0)
    >>> round(correlation_windows(rng.normal(size=20000), np.zeros(20000, int)))
    1
    """
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if not power > 0.0:  # also where a residual is unknown
        return 1.0
    time_windows = 1.0
    for lag in range(1, min(len(centred) // 4, LONGEST_LAG)):
        same_run = run[lag:] == run[:-lag]
        correlation = float(centred[lag:][same_run] @ centred[:-lag][same_run]) / power
        if correlation < UNCORRELATED:
            break
        time_windows += 2.0 * correlation  # of the lag and of its negative
    return time_windows


def independent_windows(residual: Array, run: Index) -> float:
    """Effective sample size of residuals, (windows,): windows over their autocorrelation time; two
    at least."""
    return max(len(residual) / correlation_windows(residual, run), 2.0)


def innovations(residual: Array, run: Index, *causes: Array) -> tuple[Index, list[Array]]:
    """Windows after the first few of a run, and what those before do not predict of a residual,
    shape (windows,).

    The residual is taken as autoregressive, one process in all runs. Causes, (windows, ...), are
    filtered likewise.

    >>> steps = np.repeat([0.0, 1.0, 0.0, 1.0], 50) + np.random.default_rng(0).normal(0.0, 0.01, 200)
    >>> _, (left,) = innovations(steps, np.zeros(200))
    >>> bool(np.mean(left**2) > 1.0 / 200)
    True
    """
    rows = np.arange(_PAST, len(residual))
    rows = rows[run[rows] == run[rows - _PAST]]

    def past(values: Array) -> Array:
        return np.stack([values[rows - lag] for lag in range(1, _PAST + 1)], axis=-1)

    weights = np.linalg.lstsq(past(residual), residual[rows], rcond=None)[0]
    filtered = [np.asarray(series[rows] - past(series) @ weights) for series in (residual, *causes)]
    return rows, filtered


@dataclass(frozen=True)
class Noise:
    """Noise of a series of windows: autocorrelation time in windows, and long-run standard
    deviation."""

    correlation: float
    long_run: float  # sqrt of the variance of a sum of n windows over n


def noise_of(residual: Array, run: Index, lags: Sequence[int] = (1, 2, 4, 8, 16)) -> Noise:
    """Noise of residuals, shape (windows,), from their increments, so that a few change points do
    not count as noise.

    The increments over k and 2 k windows of an autoregressive process have a ratio of variances of
    1 + phi^k. Medians are robust to the few increments across a change; the shorter the lags, the
    fewer they are.

    >>> rng = np.random.default_rng(0)
    >>> series = rng.normal(size=20000) + 50.0 * (np.arange(20000) // 1000 % 2)
    >>> noise = noise_of(series, np.zeros(20000, dtype=int), lags=(1, 2, 4))
    >>> round(noise.correlation), round(noise.long_run)
    (1, 1)
    """
    largest = Noise(correlation=1.0, long_run=_spread(residual, run, 1) / np.sqrt(2.0))
    for lag in lags:
        variance_of_steps = _spread(residual, run, lag) ** 2
        variance_of_double_steps = _spread(residual, run, 2 * lag) ** 2
        if variance_of_steps <= 0.0 or variance_of_double_steps <= 0.0:
            continue
        ratio = variance_of_double_steps / variance_of_steps
        phi = float(np.clip(ratio - 1.0, 0.0, MOST_CORRELATED)) ** (1.0 / lag)
        variance = variance_of_steps / (2.0 * (1.0 - phi**lag))
        correlation = (1.0 + phi) / (1.0 - phi)
        if variance * correlation > largest.long_run**2:
            largest = Noise(correlation, long_run=float(np.sqrt(variance * correlation)))
    return largest


def _spread(values: Array, run: Index, lag: int) -> float:
    """Standard deviation of increments over a lag within runs, from their median size."""
    same_run = run[lag:] == run[:-lag]
    sizes = np.abs(values[lag:] - values[:-lag])[same_run]
    if not len(sizes):
        return 0.0
    return 1.4826 * float(np.median(sizes))  # of normal noise, 1 / ndtri(0.75)


def shifted_in_time(columns: Array, rng: np.random.Generator) -> Array:
    """Placebo: columns, (windows, columns), shifted circularly over all runs by a random time,
    which are no cause."""
    margin = len(columns) // 10
    return np.roll(columns, int(rng.integers(margin, len(columns) - margin)), axis=0)
