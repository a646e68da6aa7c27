"""What is missing, as the result has it: each effect with its numbers, where it acts, and how sure that is."""

from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.diagnosis.explain.places import places, places_of
from homeward.diagnosis.result import MissingPhysics, Place, Proof, Value
from homeward.diagnosis.tell.next_drive import to_tell_apart


def missing_physics(evidence: Evidence) -> tuple[MissingPhysics, ...]:
    """The named effects, then those that other channels than power show."""
    runs, corrected, found = evidence.runs, evidence.corrected, []
    for index, one in enumerate(evidence.naming.named):
        assert corrected is not None
        found.append(
            _of(
                one.term.hypothesis,
                corrected.parameters_of(index),
                places(one.term, corrected.contribution[index], runs),
                Proof(one.delta_bic, one.held_out_gain, one.p_value),
                tuple(rival.effect for rival in one.rivals),
                to_tell_apart(evidence.fitted, runs, evidence.left, one.term, one.rivals),
            )
        )
    for shown in evidence.witnessed:
        where = places_of(shown.contribution, runs, None, shown.contribution != 0.0)
        measurement = shown.hypothesis.measurement
        advice = f"{measurement[0].upper()}{measurement[1:]}." if shown.rivals else ""
        found.append(_of(shown.hypothesis, dict(shown.parameters), where, shown.proof, shown.rivals, advice))
    return tuple(found)


def _of(
    one: Hypothesis, numbers: dict[str, Value], where: tuple[Place, ...], proof: Proof, rivals: tuple[str, ...],
    advice: str,
) -> MissingPhysics:  # fmt: skip
    entry = one.entry
    return MissingPhysics(
        one.id, one.name, entry.sentence, entry.equation, entry.source, numbers, where, proof, rivals, advice
    )
