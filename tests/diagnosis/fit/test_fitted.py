"""A fit with further columns, and what a drive excites."""

import dataclasses

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis.fit.fitted import excited, with_columns
from homeward.diagnosis.fit.refit import Refit, refit
from homeward.diagnosis.fit.replay import Runs


def test_a_column_that_explains_the_rest_predicts_windows_that_were_not_fitted(
    short_fit: Refit, short_runs: Runs
) -> None:
    column = np.sin(short_runs.time_s / 7.0)
    observed = short_fit.predicted + 12.0 * column
    chosen = short_runs.run < 2
    np.testing.assert_allclose(
        with_columns(short_fit, chosen, observed, column[:, None]), observed, atol=1e-4
    )
    without = with_columns(short_fit, chosen, observed, np.empty((len(observed), 0)))
    assert np.std(observed - without) > 5.0


def test_groups_stay_within_their_bounds_beside_further_columns(
    short_fit: Refit, short_runs: Runs
) -> None:
    """Idle power is no less than zero, however much less is recorded."""
    observed = short_fit.predicted - 1000.0
    everything = np.ones(len(observed), dtype=bool)
    found = with_columns(short_fit, everything, observed, np.empty((len(observed), 0)))
    assert float(np.mean(found)) > 0.0
    with_offset = with_columns(short_fit, everything, observed, np.ones((len(observed), 1)))
    np.testing.assert_allclose(with_offset, observed, atol=0.1)


@pytest.mark.parametrize(
    ("name", "lacks"), [("grade_rad", "mass"), ("sensing_hz", "sample_energy")]
)
def test_a_group_is_excited_by_what_changes_its_prediction(
    name: str, lacks: str, short_fit: Refit, husky: Robot, short_runs: Runs
) -> None:
    assert excited(short_fit, short_runs).all()
    level = []
    for run in short_runs.signals:
        nothing = np.zeros(len(run.time_s))
        still = {"accel_mps2": nothing} if name == "grade_rad" else {}
        level.append(dataclasses.replace(run, **{name: nothing}, **still))  # type: ignore[arg-type]
    runs = dataclasses.replace(
        short_runs, signals=level, context={**short_runs.context, name: 0.0 * short_fit.predicted}
    )
    moving = excited(refit(runs, husky), runs, share=0.02)
    names = [one.name for one in short_fit.parameters.groups]
    assert not moving[names.index(lacks)] and moving[names.index("rolling")]
