"""The tails of estimates against scipy's Student's t and normal distribution."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from homeward.estimation.rules import DEGREES
from homeward.estimation.tails import deviations, normal_risk, scale_of, true_risk

STUDENT = stats.t(DEGREES)
RISKS = st.floats(1e-6, 0.999)  # above, a double holds the rest to 1 too coarsely


@pytest.mark.parametrize("share", [1e-6, 1e-3, 0.05, 0.3, 0.5, 0.95, 0.999])
def test_deviations_are_the_quantile_of_students_t(share: float) -> None:
    assert deviations(share) == pytest.approx(STUDENT.ppf(share), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("risk", [1e-6, 1e-3, 0.05, 0.5, 0.999])
def test_a_risk_is_the_normal_tail_at_the_same_deviations(risk: float) -> None:
    assert normal_risk(risk) == pytest.approx(stats.norm.cdf(STUDENT.ppf(risk)), rel=1e-9)


def test_the_shields_risk_of_one_in_a_million_is_one_in_a_thousand() -> None:
    assert true_risk(1e-6) == pytest.approx(1e-3, rel=0.05)


@given(RISKS)
def test_one_undoes_the_other(risk: float) -> None:
    assert true_risk(normal_risk(risk)) == pytest.approx(risk, rel=1e-6)


@given(st.floats(1e-9, 0.1))
def test_tails_are_heavier_than_normal_ones(normal: float) -> None:
    assert true_risk(normal) > normal
    assert deviations(normal) < stats.norm.ppf(normal)
    assert true_risk(normal) + true_risk(1.0 - normal) == pytest.approx(1.0, abs=1e-6)


def test_a_certain_estimate_has_a_risk_that_is_a_number() -> None:
    """What a filter calls impossible or certain is still a probability, next to 0 and 1."""
    assert 0.0 < true_risk(0.0) < 1e-8
    assert 0.9999 < true_risk(1.0) < 1.0


@pytest.mark.parametrize("sd", [0.0, 0.02, 3.0])
def test_a_scaled_student_has_the_central_interval_of_the_normal_distribution(sd: float) -> None:
    np.testing.assert_allclose(
        [scale_of(sd) * deviations(share) for share in (0.05, 0.95)], sd * stats.norm.ppf([0.05, 0.95]), atol=1e-12
    )
