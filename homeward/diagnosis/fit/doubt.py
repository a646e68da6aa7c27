"""What the errors of the channels themselves do to a prediction: no physics has to explain as much."""

import dataclasses

import numpy as np

from homeward.diagnosis import rules
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array

SMOOTHED = ("speed_mps", "yaw_rate_radps", "grade_rad")
"""Channels whose error is known."""

_OWN = {"accel_mps2": ("speed_mps",), "base_distance_m": SMOOTHED, "heading_rad": SMOOTHED, "time_s": SMOOTHED}


def doubted(fit: Fitted, runs: Runs, channel: str = "time_s") -> float:
    """Sum over windows of the expected squared error of a prediction by errors that may look like `channel`'s doing.

    The error of a smoothed channel goes with the channel itself, as no smoother knows how its values are distributed.
    It lasts as long as the channel is smoothed over, and comes back where the same ground is driven again; and where
    the place tells a slope better than its own noisy channel does, a hidden one would stand for the slope itself.
    """
    total = 0.0
    for name in _OWN.get(channel, (channel,)):
        if name in SMOOTHED and any(name in run.error for run in runs.signals):
            sides = [fit.parameters.predict(_moved(runs, name, sign), fit.theta) for sign in (1.0, -1.0)]
            total += float(np.sum((sides[0] - sides[1]) ** 2)) / 4.0
    return total


def _moved(runs: Runs, name: str, sign: float) -> Runs:
    """The runs with a channel off by its error; at rest the speed is known."""
    moved = []
    for run in runs.signals:
        values: Array = getattr(run, name)
        size = sign * rules.SMOOTHING_ERROR * run.error.get(name, 0.0) * (values != 0.0 if name == "speed_mps" else 1.0)
        moved.append(dataclasses.replace(run, **{name: values + size}))  # type: ignore[arg-type]
    return dataclasses.replace(runs, signals=moved)


def reliability(name: str, runs: Runs) -> float:
    """Share of the variance of a channel over windows that is known, 1 where it was not smoothed."""
    if name not in runs.context:
        return 1.0
    values = runs.context[name]
    signal = float(np.nanvar(values))
    wrong = float(np.mean([run.error.get(name, 0.0) ** 2 for run in runs.signals]))
    return signal / (signal + wrong) if wrong > 0.0 else 1.0
