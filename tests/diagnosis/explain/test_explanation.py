"""What is named gives way to a channel that explains more, and to none that only stands for time."""

import dataclasses
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording, diagnose
from homeward.diagnosis.explain import explanation
from homeward.diagnosis.explain.explanation import _of_another_channel, _Residual
from homeward.diagnosis.explain.naming import Naming


@pytest.mark.parametrize(
    ("channel", "share", "gives_way"),
    [("temperature_c", 0.7, True), ("temperature_c", 0.4, False), ("speed_mps", 0.7, False), ("soc", 0.7, False)],
)
def test_an_effect_gives_way_to_a_channel_that_explains_more(channel: str, share: float, gives_way: bool) -> None:
    """Viscous friction explains half; what is left depends on a channel that explains a share."""
    term: Any = SimpleNamespace(hypothesis=SimpleNamespace(channels=("speed_mps",)))
    naming: Any = SimpleNamespace(named=(SimpleNamespace(term=term, rivals=(), held_out_gain=0.5),))
    most: Any = SimpleNamespace(channel=SimpleNamespace(name=channel), held_out_gain=share)
    remaining: Any = SimpleNamespace(channel=channel)
    assert _of_another_channel(naming, remaining, most) == gives_way


def residual_of(refit: Any = None, runs: Any = None) -> _Residual:
    """The residual of a refit, with what is asked of them replaced by the test."""
    most: Any = SimpleNamespace(found=False)
    by_run: Any = None
    return _Residual(refit, runs, most, np.zeros(5, np.intp), by_run, np.random.default_rng(0), lambda _: None)


@pytest.mark.parametrize(("ground", "stands"), [(True, True), (False, False)])
def test_the_place_refutes_a_schedule_unless_a_named_ground_explains_it(
    monkeypatch: pytest.MonkeyPatch, ground: bool, stands: bool
) -> None:
    """The place explains as much as the schedule of a load: alone it refutes the load, beside a named ground not."""
    for name, found in (("place_gain", 0.9), ("largest_by_motion", 0.0), ("explained", 0.8), ("unexplained", False)):
        monkeypatch.setattr(explanation, name, lambda *_, found=found: found)
    for name in ("fit_model", "holding"):
        monkeypatch.setattr(explanation, name, lambda *_: None)
    monkeypatch.setattr(explanation, "name_missing", lambda *_: Naming())
    kinds = (("time", False), ("place", True))[: 1 + ground]
    terms = [SimpleNamespace(axis=axis, hypothesis=SimpleNamespace(by_place=of, channels=())) for axis, of in kinds]
    named: Any = tuple(SimpleNamespace(term=term, held_out_gain=0.7) for term in terms)
    corrected: Any = SimpleNamespace(
        contribution=(None,), model=SimpleNamespace(terms=terms), groups=SimpleNamespace(held=None)
    )
    location: Any = "further from base"
    naming = residual_of().checked_against_motion(Naming(named, corrected), location)[0]
    assert bool(naming.named) == stands


@pytest.mark.parametrize("beside", [True, False])
def test_motion_that_causes_another_named_effect_does_not_refute_a_schedule(
    monkeypatch: pytest.MonkeyPatch, beside: bool
) -> None:
    """Motion explains most of what the refit leaves, and nothing of what it leaves with the effect of motion."""
    refit: Any = "refit"
    monkeypatch.setattr(explanation, "holding", lambda *_: refit)
    monkeypatch.setattr(explanation, "fit_model", lambda *_: "with the effect of motion")
    monkeypatch.setattr(explanation, "largest_by_motion", lambda base, *_: 0.9 if base == refit else 0.0)
    for name, found in (("place_gain", 0.0), ("explained", 0.8), ("unexplained", False)):
        monkeypatch.setattr(explanation, name, lambda *_, found=found: found)
    monkeypatch.setattr(explanation, "name_missing", lambda *_: Naming())
    hypothesis = SimpleNamespace(by_place=False, channels=())
    terms = [SimpleNamespace(axis=axis, hypothesis=hypothesis) for axis in ("time", "steady")[: 1 + beside]]
    named: Any = tuple(SimpleNamespace(term=term, held_out_gain=0.7) for term in terms)
    corrected: Any = SimpleNamespace(
        contribution=(None,), model=SimpleNamespace(terms=terms), groups=SimpleNamespace(held=None)
    )
    location: Any = "after an hour"
    assert bool(residual_of(refit).checked_against_motion(Naming(named, corrected), location)[0].named) == beside


@pytest.mark.parametrize(
    ("unrecorded", "share", "correlated", "channel", "lacks"),
    [
        (["slopes"], 0.2, True, "grade_rad", True),
        ([], 0.2, True, "grade_rad", False),
        (["slopes"], 0.6, True, "grade_rad", False),
        (["slopes"], 0.2, False, "grade_rad", False),
        (["slopes"], 0.2, True, "heading_rad", False),  # as turning of a Husky on snow
    ],
)
def test_an_effect_that_leaves_most_is_not_named_where_hills_may_cause_the_rest(
    monkeypatch: pytest.MonkeyPatch, unrecorded: list[str], share: float, correlated: bool, channel: str, lacks: bool
) -> None:
    """Where headings go with slopes, wind explains a part of what hills cause, if it is not what shows most."""
    for name, found in (("unrecorded", unrecorded), ("explained", share), ("is_autocorrelated", correlated)):
        monkeypatch.setattr(explanation, name, lambda *_, found=found: found)
    corrected: Any = SimpleNamespace(predicted=np.zeros(5))
    most: Any = SimpleNamespace(found=True, channel=SimpleNamespace(name=channel))
    residual = dataclasses.replace(residual_of(runs=SimpleNamespace(observed=np.zeros(5))), most=most)
    wind: Any = SimpleNamespace(term=SimpleNamespace(hypothesis=SimpleNamespace(channels=("heading_rad",))))
    assert residual.lacks_a_channel(Naming((wind,), corrected)) == lacks
    assert not residual.lacks_a_channel(Naming())


def test_a_loss_that_remembers_the_fastest_speed_is_no_load_that_switches(
    drive: Callable[..., list[Recording]], husky: Robot
) -> None:
    runs = []
    for run in drive(husky, runs=4, minutes=4.0):
        time_s, speed_mps = run.channels["time_s"], np.abs(run.channels["speed_mps"])
        since = np.searchsorted(time_s, time_s - 30.0)
        fastest_mps = np.array([speed_mps[first : now + 1].max() for now, first in enumerate(since)])
        power_w = run.channels["power_w"] + 80.0 * fastest_mps**2 * speed_mps
        runs.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    assert diagnose(runs, husky).verdict == "unknown_physics"
