"""Whether a diagnosis of a case is right, and what it names wrongly."""

from __future__ import annotations

from benchmarks.concealed.fixed_way.cases import Case
from benchmarks.concealed.scoring.count import in_some_class, named
from benchmarks.concealed.scoring.outcome import Outcome

NO_ANSWERS = ("refused", "crash")
"""Verdicts of recordings that could not be diagnosed."""
NOTHING_MISSING = ("no_mismatch", "parameters_off")
"""Verdicts that are right where nothing is hidden."""


def is_right(case: Case, outcome: Outcome) -> bool:
    """Whether every true effect is in some class.

    Where nothing of the catalogue is true, it is right to say that the physics is unknown, or to
    name nothing.
    """
    if outcome.verdict in NO_ANSWERS:
        return False
    if case.cause == "none":
        return outcome.verdict in NOTHING_MISSING
    if not case.effects:
        return outcome.verdict == "unknown_physics" or not named(outcome)
    return all(in_some_class(outcome, effect) for effect in case.effects)


def wrong_names(case: Case, outcome: Outcome) -> int:
    """Number of named classes of which no member is true or tolerated."""
    accepted = {*case.effects, *case.tolerated}
    wrong = [names for names in named(outcome) if accepted.isdisjoint(names)]
    return len(wrong)
