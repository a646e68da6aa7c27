"""A load that comes and goes; a schedule shows its rhythm."""

from itertools import pairwise

import numpy as np

from homeward.diagnosis.explain.change_points import Schedule
from homeward.diagnosis.explain.hypothesis import Hypothesis, everywhere
from homeward.diagnosis.fit.replay import Runs
from homeward.physics.effects.intermittent_load import EFFECT


def _rhythm(schedule: Schedule, runs: Runs) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Mean period and share of time of what switches on and off, and their intervals over the cycles."""
    on = schedule.level > 0
    periods, duties = [], []
    for run in np.unique(runs.run):
        here = runs.run == run
        starts = np.flatnonzero(np.diff(on[here].astype(int)) > 0) + 1
        periods += np.diff(runs.time_s[here][starts]).tolist()
        duties += [float(on[here][a:b].mean()) for a, b in pairwise(starts)]
    if not periods:
        periods, duties = [2.0 * float(runs.duration_s.sum()) / max(schedule.changes, 1)], [float(on.mean())]
    found, spread = {}, {}
    window_s = float(np.median(runs.duration_s))  # a moment is known within
    for name, values, sure, low, high in (
        ("period_s", periods, window_s, 1.0, 1e5),
        ("duty", duties, window_s / float(np.mean(periods)), 0.01, 0.99),
    ):
        mean, wide = float(np.mean(values)), 2.0 * float(np.hypot(np.std(values), sure) / np.sqrt(len(values)))
        found[name] = float(np.clip(mean, low, high))
        spread[name] = (max(mean - wide, low), min(mean + wide, high))
    return found, spread


HYPOTHESIS = Hypothesis(
    EFFECT,
    steady=None,
    changes="repeatedly",
    load=everywhere,
    rhythm=_rhythm,
    otherwise="in stretches that repeat",
    check="log a clamp meter on each device for the length of a drive",
)
