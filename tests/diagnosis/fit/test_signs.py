"""A descent gives no more than its height, and a climb takes no less: that shows signs of power and
of slopes."""

import dataclasses

import numpy as np

from homeward import Robot
from homeward.diagnosis.fit.signs import signs_of_power, wrong_slopes
from homeward.diagnosis.fit.usable import fault_of, usable_runs
from homeward.diagnosis.read.signals import Signals, signals
from tests.diagnosis.fit.test_usable import drive, recording


def run_of(husky: Robot, **changed: float) -> Signals:
    """A drive of a Husky; a number given for a channel holds throughout."""
    run = signals(recording(drive()), husky)
    arrays = {name: np.full(len(run.time_s), value) for name, value in changed.items()}
    context = {
        **run.context,
        **{name: values for name, values in arrays.items() if name in run.context},
    }
    return dataclasses.replace(run, **arrays, context=context)  # type: ignore[arg-type]


def test_what_a_descent_can_give_is_no_wrong_sign(husky: Robot) -> None:
    # gives mass x 9.8 x 0.5 x sin 0.3 > 50 W
    downhill = run_of(husky, observed=-50.0, speed_mps=0.5, grade_rad=-0.3)
    assert (
        fault_of(
            dataclasses.replace(downhill, observed=downhill.observed - 1e-9 * downhill.time_s),
            husky,
        )
        is None
    )
    steep = signs_of_power([downhill], husky)[0]
    assert not steep.refused and "that its descent gives" in steep.text
    level = signs_of_power([run_of(husky, observed=-50.0, speed_mps=0.5, grade_rad=-1e-3)], husky)[
        0
    ]
    assert level.refused and "in 1 of 1 runs" in level.text and "factor -1" in level.text


def test_where_slopes_are_unknown_the_runs_decide_together(husky: Robot) -> None:
    flat = run_of(husky)
    flat = dataclasses.replace(
        flat, context={k: v for k, v in flat.context.items() if k != "grade_rad"}
    )
    back = dataclasses.replace(flat, observed=-0.2 * flat.observed)
    signs = signs_of_power([flat, flat, back], husky)
    assert list(signs) == [2] and not signs[2].refused and "in 1 of 3 runs" in signs[2].text
    assert all(
        sign.refused
        for sign in signs_of_power([back, back, flat, back, back, back, back], husky).values()
    )


def test_climbs_that_draw_less_show_slopes_of_the_wrong_sign(husky: Robot) -> None:
    right = recording(drive())
    turned = recording({**drive(), "grade_rad": -drive()["grade_rad"]}, "turned.csv")
    assert wrong_slopes([signals(right, husky)], husky) is None
    assert "is uphill positive?" in str(wrong_slopes([signals(turned, husky)], husky))
    _, findings = usable_runs([turned], husky)
    assert any("is uphill positive?" in finding.text for finding in findings)
