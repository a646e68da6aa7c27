"""When to make an excitation step towards home, which distinguishes wind from rolling
resistance."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation import thresholds


def looks_back(
    decisions: Any,
    position_m: Any,
    cruise_mps: float,
    decision_s: float,
    weather_changes: bool = True,
) -> Any:
    """Whether the next decision should be an excitation step: towards home, and then out again.

    Args:
        decisions: Number of decisions so far, any shape.
        position_m: Way home, m, any shape.
        cruise_mps: Speed at which the robot drives out.
        decision_s: Time between decisions, s.
        weather_changes: Whether the weather changes during the mission.

    >>> [looks_back(k, 500.0, 1.0, 30.0) for k in (9, 10, 30)]
    [False, True, True]
    """
    every = thresholds.EXCITATION_EVERY[int(weather_changes)]
    is_due = np.asarray(decisions) % every == thresholds.EXCITATION_AT
    is_far = np.asarray(position_m) > thresholds.EXCITATION_FAR * cruise_mps * decision_s
    should = is_due & is_far
    if should.ndim:
        return should
    return bool(should)
