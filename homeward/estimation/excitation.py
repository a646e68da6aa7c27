"""When to make an excitation step towards home, which distinguishes wind from rolling resistance."""

from __future__ import annotations

from typing import Any

import numpy as np

_EVERY, _AT = (40, 20), 10
"""Decisions per excitation step (driven towards home at the lowest speed) in still and in changing weather, and the
first one: of 10 to 50 by trial on OutAndBack. Each lowers the planner's score by 0.1 to 0.2 %. Without any, 19 % of
its missions strand in winds that the forecast lacks, with them 1.1 % (docs/results.md)."""
_FAR = 1.5
"""Distance from home, in decisions at cruise, from which it is useful. Chosen: nearer, the robot is about home."""


def looks_back(
    decisions: Any, position_m: Any, cruise_mps: float, decision_s: float, weather_changes: bool = True
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
    due = np.asarray(decisions) % _EVERY[int(weather_changes)] == _AT
    due = due & (np.asarray(position_m) > _FAR * cruise_mps * decision_s)
    return due if due.ndim else bool(due)
