"""Missing physics for the result: each effect with its parameters, its places and the evidence for it."""

from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.diagnosis.explain.places import places, places_of
from homeward.diagnosis.result import MissingPhysics, NotNamed, Proof
from homeward.diagnosis.tell.next_drive import to_tell_apart


def missing_physics(evidence: Evidence) -> tuple[MissingPhysics, ...]:
    """The named effects, then those that other channels than power show."""
    runs, corrected, found = evidence.runs, evidence.corrected, []
    for index, one in enumerate(evidence.naming.named):
        assert corrected is not None
        numbers, where = corrected.parameters_of(index), places(one.term, corrected.contribution[index], runs)
        proof, rivals = Proof(one.delta_bic, one.held_out_gain, one.p_value), tuple(term.effect for term in one.rivals)
        drive = to_tell_apart(evidence.fitted, runs, evidence.residual, one.term, one.rivals)
        description = _description(one.term.hypothesis)
        found.append(MissingPhysics(*description, numbers, where, proof, rivals, drive, one.checks))
    for shown in evidence.channel_effects:
        where = places_of(shown.contribution, runs, None, shown.contribution != 0.0)
        measurement = shown.hypothesis.measurement
        advice = f"{measurement[0].upper()}{measurement[1:]}." if shown.rivals else ""
        numbers = dict(shown.parameters)
        found.append(MissingPhysics(*_description(shown.hypothesis), numbers, where, shown.proof, shown.rivals, advice))
    return tuple(found)


def not_named(evidence: Evidence) -> tuple[NotNamed, ...]:
    """Effects that were tried and not named, with their conditions: of each the try that met most."""
    named = {effect.term.effect for effect in evidence.naming.named}
    furthest: dict[str, NotNamed] = {}
    for tried in evidence.naming.refused:
        before = furthest.get(tried.effect)
        if tried.effect not in named and (before is None or len(before.conditions) < len(tried.checks)):
            furthest[tried.effect] = NotNamed(tried.effect, tried.checks)
    return tuple(furthest.values())


def _description(hypothesis: Hypothesis) -> tuple[str, str, str, str, str]:
    return hypothesis.id, hypothesis.name, hypothesis.entry.sentence, hypothesis.entry.equation, hypothesis.entry.source
