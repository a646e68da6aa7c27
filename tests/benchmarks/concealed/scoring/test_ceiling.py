"""What the recordings prove of effects whose exact contribution is known."""

import dataclasses

import pandas as pd
import pytest

from benchmarks.concealed.plants.cases import Case
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.scoring.ceiling import provable


@pytest.fixture(scope="module")
def pair() -> Case:
    """A computer and an internal resistance of a Jackal, with low noise."""
    return make_case("pairs", 1, 0, short=True)


def test_recordings_without_an_effect_have_the_same_drives_and_noise(pair: Case) -> None:
    assert pair.without is not None
    for whole, left in zip(pair.recordings, pair.without("none of them"), strict=True):
        pd.testing.assert_frame_equal(whole, left)
    for effect in pair.hidden:
        whole, left = pair.recordings[0], pair.without(effect)[0]
        assert (whole["power_w"] != left["power_w"]).any()
        pd.testing.assert_series_equal(whole["time_s"], left["time_s"])


def test_a_clear_contribution_is_provable_and_none_is_not(pair: Case) -> None:
    assert all(provable(pair).values())
    nothing = dataclasses.replace(
        pair, without=lambda effect: pair.recordings, refit_misses=dict.fromkeys(pair.hidden, 0.0)
    )
    assert not any(provable(nothing).values())
    shown_elsewhere = dataclasses.replace(nothing, refit_misses=dict.fromkeys(pair.hidden, 1.0))
    assert all(provable(shown_elsewhere).values())


def test_nothing_is_said_of_a_case_without_effects_or_with_other_windows(pair: Case) -> None:
    assert provable(dataclasses.replace(pair, without=None)) == {}
    shorter = [one.iloc[: len(one) // 2] for one in pair.recordings]
    assert provable(dataclasses.replace(pair, without=lambda effect: shorter)) == {}
