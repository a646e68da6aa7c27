"""All hypotheses about a set of recordings."""

from __future__ import annotations

import numpy as np

from homeward.diagnosis.hypotheses import CATALOGUE, OF_CURRENT, Setting, Term
from homeward.diagnosis.scheduled import scheduled
from homeward.diagnosis.steady import steady


def terms(setting: Setting, leave_out: tuple[str, ...] = (), schedules: bool = True) -> list[Term]:
    """Every hypothesis that the channels of these runs allow.

    Args:
        setting: What is known so far.
        leave_out: Effects that are already in the model.
        schedules: Whether those whose size changes for no recorded reason are among them.
    """
    found: list[Term] = []
    for effect in CATALOGUE:
        if effect in leave_out or (setting.runs.unit == "A" and effect not in OF_CURRENT):
            continue
        forms = [*steady(effect, setting), *(scheduled(effect, setting) if schedules else ())]
        found += [term for term in forms if np.isfinite(term.columns).all() and term.columns.any()]
    return found
