"""Missing physics as the result has it: named effects first, then those that other channels
show."""

import dataclasses

import numpy as np
import pytest

from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.result import Proof, Value
from homeward.diagnosis.tell.missing import missing_physics, within_bounds


@pytest.fixture(scope="module")
def evidence(scrubbing_evidence: Evidence) -> Evidence:
    """Turning is named, and a voltage shows a resistance in the second run, and hardly any in the
    third."""
    lost_w = np.array([0.0, 3.0, 0.01, 0.0])[scrubbing_evidence.runs.run]
    numbers = {"ohm": Value(0.2, (0.1, 0.3), "ohm")}
    shown = ChannelEffect(
        CATALOGUE["internal_resistance"], numbers, lost_w, Proof(9.0, 0.5, 0.001), (), "It sags."
    )
    return dataclasses.replace(scrubbing_evidence, channel_effects=(shown,))


def test_effects_have_their_words_sizes_and_evidence(evidence: Evidence) -> None:
    turning, sag = missing_physics(evidence)
    for found, one in ((turning, CATALOGUE["turning"]), (sag, CATALOGUE["internal_resistance"])):
        assert (found.effect, found.name) == (one.id, one.name)
        assert (found.sentence, found.equation, found.source) == (
            one.entry.sentence, one.entry.equation, one.entry.source,
        )  # fmt: skip
    (named,) = evidence.naming.named
    assert turning.evidence == Proof(named.delta_bic, named.held_out_gain, named.p_value)
    assert turning.parameters["scrub"].value == pytest.approx(0.3, rel=0.15)
    assert sag.evidence.delta_bic == 9.0 and sag.parameters == {
        "ohm": Value(0.2, (0.1, 0.3), "ohm")
    }


def test_an_effect_of_another_channel_is_where_it_takes_something(evidence: Evidence) -> None:
    _, sag = missing_physics(evidence)
    assert [one.recording for one in sag.where] == evidence.runs.names[1:3]
    assert sag.where[0].share_of_excess == pytest.approx(300.0 / 301.0, rel=1e-3)


def test_only_what_is_confounded_has_to_be_told_apart(evidence: Evidence) -> None:
    assert missing_physics(evidence)[1].to_tell_apart == ""
    (shown,) = evidence.channel_effects
    rivalled = dataclasses.replace(shown, rivals=("ageing",))
    _, sag = missing_physics(dataclasses.replace(evidence, channel_effects=(rivalled,)))
    assert sag.confused_with == ("ageing",)
    measurement = CATALOGUE["internal_resistance"].measurement
    assert sag.to_tell_apart.lower() == f"{measurement}.".lower() and sag.to_tell_apart[0].isupper()


def test_rivals_of_a_named_effect_are_told_apart_by_a_drive(evidence: Evidence) -> None:
    (named,) = evidence.naming.named
    rival = dataclasses.replace(named.term, hypothesis=CATALOGUE["viscous"])
    naming = dataclasses.replace(
        evidence.naming, named=(dataclasses.replace(named, rivals=(rival,)),)
    )
    turning, _ = missing_physics(dataclasses.replace(evidence, naming=naming))
    assert turning.confused_with == ("viscous",)
    assert turning.to_tell_apart.startswith("To distinguish turning from viscous, ")


def test_nothing_is_missing_of_a_robot_as_its_file_says(faultless_evidence: Evidence) -> None:
    assert missing_physics(faultless_evidence) == ()


@pytest.mark.parametrize(
    ("ci95", "within"),
    [
        ((0.2, 0.4), (0.2, 0.4)),
        ((-0.1, 0.4), (0.0, 0.4)),
        ((0.9, 1.2), (0.9, 1.0)),
        ((0.0, 1.0), None),
        ((-3.0, 3.0), None),
        (None, None),
    ],
)
def test_an_interval_ends_at_the_bounds_and_is_none_where_it_is_all_between_them(
    ci95: tuple[float, float] | None, within: tuple[float, float] | None
) -> None:
    assert within_bounds(ci95, 0.0, 1.0) == within
