"""Everything that can be named: each effect of the physics and each fault of an instrument, as a hypothesis.

A file beside this one says what is particular to an effect; an effect without one is tried by the defaults.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting, Term
from homeward.physics.effects import EFFECTS

_INSTRUMENTS = ("sensor_offset", "sensor_gain", "clock_lag", "odometry_scale")


def _with_file(name: str) -> Hypothesis:
    found: Hypothesis = import_module(f"{__name__}.{name}").HYPOTHESIS
    return found


CATALOGUE: Mapping[str, Hypothesis] = {
    **{one.id: _with_file(one.id) if find_spec(f"{__name__}.{one.id}") else Hypothesis(one) for one in EFFECTS},
    **{name: _with_file(name) for name in _INSTRUMENTS},
}
"""Every hypothesis, by id."""


def terms(setting: Setting, leave_out: tuple[str, ...] = (), schedules: bool = True) -> list[Term]:
    """Every form of every hypothesis that the channels of these runs allow.

    Args:
        setting: What is known so far.
        leave_out: Effects that are already in the model.
        schedules: Whether those whose size changes for no recorded reason are among them.
    """
    found: list[Term] = []
    for effect, one in CATALOGUE.items():
        if effect not in leave_out and (setting.runs.unit == "W" or one.of_current):
            forms = one.forms(setting, schedules)
            found += [term for term in forms if np.isfinite(term.columns).all() and term.columns.any()]
    return found


def what_can_be_shown(absorbed: Mapping[str, float]) -> dict[str, float | None]:
    """For every effect the share that the refit would absorb, None where a channel lacks or nothing excites it."""
    return {effect: absorbed.get(effect) for effect in CATALOGUE}
