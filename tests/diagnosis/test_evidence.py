"""What the report asks of the evidence: of the right model, and of trips as they were held out."""

import dataclasses

import numpy as np
import pytest

from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.result import Proof
from homeward.logs.channels import Mask


@pytest.fixture(scope="module")
def corrected(scrubbing_evidence: Evidence) -> Corrected:
    assert scrubbing_evidence.corrected is not None
    return scrubbing_evidence.corrected


def test_a_trip_is_a_run_even_where_stretches_are_held_out(scrubbing_evidence: Evidence) -> None:
    """Stretches of all runs mixed have no energy of a trip: errors of opposite signs cancel in
    them."""
    fold = np.arange(len(scrubbing_evidence.fold)) % 7
    mixed = dataclasses.replace(scrubbing_evidence, held_out_by="block", fold=fold)
    np.testing.assert_array_equal(mixed.trip, scrubbing_evidence.runs.run)


def test_of_few_runs_a_trip_is_a_stretch(scrubbing_evidence: Evidence) -> None:
    runs = scrubbing_evidence.runs
    one = dataclasses.replace(runs, signals=runs.signals[:1], run=np.zeros_like(runs.run))
    block = np.arange(len(runs.run)) // 30
    few = dataclasses.replace(scrubbing_evidence, runs=one, block=block)
    assert few.blocks == block[-1] + 1
    np.testing.assert_array_equal(np.unique(few.trip), np.arange(5))
    assert (np.diff(few.trip) >= 0).all()


def test_the_residual_is_that_of_the_best_model(
    scrubbing_evidence: Evidence, corrected: Corrected
) -> None:
    np.testing.assert_array_equal(
        scrubbing_evidence.residual, scrubbing_evidence.runs.observed - corrected.predicted
    )
    plain = dataclasses.replace(scrubbing_evidence, corrected=None)
    np.testing.assert_array_equal(
        plain.residual, scrubbing_evidence.runs.observed - scrubbing_evidence.fitted.predicted
    )
    assert scrubbing_evidence.residual.std() < 0.7 * plain.residual.std()


def test_held_groups_are_those_of_the_model_that_is_reported(
    scrubbing_evidence: Evidence, corrected: Corrected
) -> None:
    groups = [one.symbol for one in scrubbing_evidence.fitted.parameters.groups]

    def holding(index: int) -> Mask:
        return np.asarray(np.arange(len(groups)) == index)

    held = dataclasses.replace(
        scrubbing_evidence,
        plain=dataclasses.replace(scrubbing_evidence.plain, held=holding(0)),
        corrected=dataclasses.replace(
            corrected, groups=dataclasses.replace(corrected.groups, held=holding(4))
        ),
    )
    assert held.held == ("m / Gamma",)
    assert dataclasses.replace(held, corrected=None).held == ("P_anc, idle part",)


def test_only_a_group_with_value_and_interval_is_measured(scrubbing_evidence: Evidence) -> None:
    first, second, *others = scrubbing_evidence.estimates
    some = dataclasses.replace(
        scrubbing_evidence,
        estimates=(
            dataclasses.replace(first, fitted=60.0, ci95=(59.0, 61.0), status="fitted"),
            second.confounded(()),
            *(dataclasses.replace(one, fitted=None, ci95=None) for one in others),
        ),
    )
    (known,) = some.measured
    assert (known.group, known.assumed, known.fitted, known.ci95) == (
        first.group.symbol, first.assumed, 60.0, (59.0, 61.0),
    )  # fmt: skip


def test_contributions_are_those_of_named_effects_and_then_those_of_other_channels(
    scrubbing_evidence: Evidence, corrected: Corrected
) -> None:
    lost_w = np.full(len(scrubbing_evidence.runs.observed), 3.0)
    shown = ChannelEffect(
        CATALOGUE["internal_resistance"], {}, lost_w, Proof(None, 0.5, 0.001), (), "It sags."
    )
    both = dataclasses.replace(scrubbing_evidence, channel_effects=(shown,))
    named, by_voltage = both.contributions
    np.testing.assert_array_equal(named, corrected.contribution[0])
    np.testing.assert_array_equal(by_voltage, lost_w)
    assert len(dataclasses.replace(both, corrected=None).contributions) == 1


def test_the_accuracy_of_a_range_is_that_of_each_arm_on_its_trips(
    scrubbing_evidence: Evidence,
) -> None:
    """A model that predicts four fifths of each trip promises a range that is a quarter too
    long."""
    observed = scrubbing_evidence.runs.observed
    found = dataclasses.replace(
        scrubbing_evidence, predictions={"exact": observed, "low": 0.8 * observed}
    ).range_accuracy_pct
    assert found["exact"] == pytest.approx(100.0) and found["low"] == pytest.approx(75.0)
