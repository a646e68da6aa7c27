"""One effect is a simpler explanation than several wrong parameters, and one wrong parameter than
an effect."""

import dataclasses
from collections.abc import Callable

import pytest

from homeward import Robot
from homeward.diagnosis import Recording, analyse
from homeward.diagnosis.explain.parsimony import needless
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]


def windows(recordings: list[Recording], robot: Robot) -> Runs:
    return average(usable_runs(recordings, robot)[0])


def test_slip_that_a_refit_takes_up_is_named_and_the_parameters_are_left_alone(
    drive: Drive, husky: Robot
) -> None:
    true = dataclasses.replace(husky, effects={"slip": {"per_load": 0.5}})
    analysis = analyse(drive(true), husky)
    (slip,) = analysis.diagnosis.missing_physics
    assert "slip" in (slip.effect, *slip.confused_with)
    assert ends(slip.parameters[next(iter(slip.parameters))])[0] > 0.0
    assert analysis.diagnosis.parameters_off == ()
    mixed = (
        [one.mixed_with for one in analysis.evidence.estimates if one.status == "confounded"]
        if analysis.evidence
        else []
    )
    assert mixed and all(mixed)  # else the report calls them noise


@pytest.mark.parametrize(
    "wrong",
    [
        {"mass_kg": 1.25},
        {"rolling_resistance": 0.7},
        {"mass_kg": 0.8, "controller_w": 1.3},
        {"sensing_j_per_sample": 2.0},
    ],
    ids=" ".join,
)
def test_numbers_that_are_off_are_no_effect(
    drive: Drive, husky: Robot, wrong: dict[str, float]
) -> None:
    """A mass that is off changes C_rr m too: together they count as one number."""
    changed = {name: factor * getattr(husky, name) for name, factor in wrong.items()}
    runs = windows(drive(husky), dataclasses.replace(husky, **changed))
    assert needless(refit(runs, dataclasses.replace(husky, **changed)), runs) is None


def test_an_exact_file_needs_no_effect(drive: Drive, husky: Robot) -> None:
    runs = windows(drive(husky), husky)
    assert needless(refit(runs, husky), runs) is None
