"""Ancillary power of a robot at standstill, with autocorrelation and the spread between runs in its
error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis.read.signals import WINDOW_S, Unit, observed_of, windows
from homeward.diagnosis.thresholds import FEWEST_SAMPLES
from homeward.groups import thresholds
from homeward.logs import thresholds as logs_thresholds
from homeward.logs.autocorrelation import correlation_windows
from homeward.logs.channels import MOTION, Array
from homeward.logs.columns import RecordingError
from homeward.logs.recordings import Recording
from homeward.logs.times import median_step_s


@dataclass(frozen=True)
class StandingRun:
    """Power or current of one run of a robot at standstill."""

    unit: Unit
    mean: float  # W, or A where only motor current was recorded
    ci95: tuple[float, float]  # of this run alone, without the spread between runs
    change: float  # mean of the last third minus that of the first
    variation: float  # standard deviation of window means over their mean
    voltage_v: float  # NaN where it was not recorded

    @property
    def unsteady(self) -> bool:
        """Whether the power varies more than is typical at standstill."""
        return self.variation > thresholds.STEADY


def stands(recording: Recording) -> bool:
    """Whether the recorded motion is zero throughout; False where no motion was recorded."""
    motion = [name for names in MOTION for name in names if name in recording.channels]
    speeds_mps = np.concatenate([np.zeros(0), *(recording.channels[name] for name in motion)])
    speeds_mps = speeds_mps[np.isfinite(speeds_mps)]
    if len(speeds_mps) == 0:
        return False
    turning_radps = np.abs(recording.channels.get("yaw_rate_radps", np.zeros(1)))
    moves = bool((np.abs(speeds_mps) > logs_thresholds.STANDSTILL_MPS).any())
    turns = bool((turning_radps > thresholds.STANDSTILL_RADPS).any())
    return not moves and not turns


def standing_run(recording: Recording) -> StandingRun:
    """Mean power of a run of a standing robot, with the interval of this run alone.

    The interval is Student's over the means of batches of eight autocorrelation times, two to ten
    of them (batch means; Schmeiser, Operations Research 30, 1982).

    Raises:
        RecordingError: Power or current is missing, constant or too short to average.
    """
    observed, unit = observed_of(recording.channels)
    is_read = np.isfinite(observed)
    time_s = recording.channels["time_s"][is_read]
    observed = observed[is_read]
    if len(observed) < FEWEST_SAMPLES or np.ptp(observed) == 0.0:
        raise RecordingError(
            f"{recording.name}: holds fewer than {FEWEST_SAMPLES} values of power or current, or one value only"
        )
    window_means = windows(time_s, max(WINDOW_S, median_step_s(time_s))).means(observed)
    if len(window_means) < thresholds.FEWEST_WINDOWS:
        raise RecordingError(
            f"{recording.name}: is too short ({time_s[-1] - time_s[0]:.3g} s) for a mean with an error"
        )
    mean = float(observed.mean())
    third = len(observed) // 3
    voltage_v = np.nan
    if "voltage_v" in recording.channels:
        voltage_v = float(np.nanmean(recording.channels["voltage_v"]))
    return StandingRun(
        unit=unit,
        mean=mean,
        ci95=mean_interval(_batch_means(window_means), mean),
        change=float(observed[-third:].mean() - observed[:third].mean()),
        variation=float(window_means.std() / max(abs(mean), 1e-12)),
        voltage_v=voltage_v,
    )


def _batch_means(window_means: Array) -> list[float]:
    """Means of batches of windows that are so long that they hardly correlate."""
    one_run = np.zeros(len(window_means), dtype=np.intp)
    windows_a_batch = np.ceil(thresholds.BATCH_TIMES * correlation_windows(window_means, one_run))
    batches = int(np.clip(len(window_means) // windows_a_batch, 2, thresholds.MOST_BATCHES))
    return [float(batch.mean()) for batch in np.array_split(window_means, batches)]


def mean_interval(values: Sequence[float], mean: float | None = None) -> tuple[float, float]:
    """Student's 95 % interval of a mean of independent values: of runs, so that their spread counts
    (random effects).

    With one value per run the spread of the values holds both the error within runs and the
    differences between them. There are at least two; the interval is about their mean or the one
    that is given.

    >>> low, high = mean_interval([9.78, 9.77, 9.81])
    >>> round(low, 2), round(high, 2)
    (9.73, 9.84)
    """
    centre = float(np.mean(values)) if mean is None else mean
    quantile = student.ppf(thresholds.UPPER_95, len(values) - 1)
    half = float(quantile * np.std(values, ddof=1) / np.sqrt(len(values)))
    return centre - half, centre + half
