"""When to drive towards home for a moment, so that what changes is the wind and what does not is the robot."""

from __future__ import annotations

from typing import Any

import numpy as np

_EVERY, _AT = (40, 20), 10
"""Decisions of which one is driven towards home, as slowly as it goes, where the weather stays and where it changes,
and which: of 10 to 50 by trial on OutAndBack. Each costs 0.1 to 0.2 % of the planner's score; without any a quarter of
its missions strand in winds that were not forecast, with them 1.4 %."""
_FAR = 1.5
"""Decisions at cruise from home from which it is worth it."""


def looks_back(
    decisions: Any, position_m: Any, cruise_mps: float, decision_s: float, weather_changes: bool = True
) -> Any:
    """Whether the next decision should be driven towards home and then out again.

    Args:
        decisions: Number of decisions so far, any shape.
        position_m: Way home, m, any shape.
        cruise_mps: Speed at which the robot drives out.
        decision_s: Time between decisions, s.
        weather_changes: Whether it does on the way.

    >>> [looks_back(k, 500.0, 1.0, 30.0) for k in (9, 10, 30)]
    [False, True, True]
    """
    due = np.asarray(decisions) % _EVERY[int(weather_changes)] == _AT
    due = due & (np.asarray(position_m) > _FAR * cruise_mps * decision_s)
    return due if due.ndim else bool(due)
