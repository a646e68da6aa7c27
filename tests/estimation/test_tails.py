"""The tails of estimates against scipy's Student's t and normal distribution."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from homeward.estimation.tails import deviations, scale_of
from homeward.estimation.thresholds import DEGREES

STUDENT = stats.t(DEGREES)


@pytest.mark.parametrize("share", [1e-6, 1e-3, 0.05, 0.3, 0.5, 0.95, 0.999])
def test_deviations_are_the_quantile_of_students_t(share: float) -> None:
    assert deviations(share) == pytest.approx(STUDENT.ppf(share), rel=1e-9, abs=1e-12)


@given(st.floats(1e-9, 0.1))
def test_tails_are_heavier_than_normal_ones(share: float) -> None:
    assert deviations(share) < stats.norm.ppf(share)


@pytest.mark.parametrize("sd", [0.0, 0.02, 3.0])
def test_a_scaled_student_has_the_central_interval_of_the_normal_distribution(sd: float) -> None:
    np.testing.assert_allclose(
        [scale_of(sd) * deviations(share) for share in (0.05, 0.95)],
        sd * stats.norm.ppf([0.05, 0.95]),
        atol=1e-12,
    )
