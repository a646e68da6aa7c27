"""From runs to a comparison: chance, drift and driving style name nothing, a changed robot or
ground is named."""

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from homeward import Robot, synthetic
from homeward.diagnosis import Recording, RecordingError
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.residual_test import independent_blocks
from homeward.diagnosis.fit.estimates import estimates
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.groups import runs as of_runs
from homeward.groups.comparison import Comparison
from homeward.groups.runs import compare_driving, compare_standing, mean_residual_of_runs
from tests.groups.recorded import noise, standing


def test_standing_groups_with_autocorrelated_noise_and_drift() -> None:
    rng = np.random.default_rng(4)
    alarms = 0
    for _ in range(100):
        warming = 3.0 * np.exp(-np.arange(120) / 40.0)
        runs = [
            standing(9.0 + rng.normal(0.0, 0.05) - warming + noise(rng, 120, 0.95))
            for _ in range(6)
        ]
        runs = [dataclasses.replace(run, name=str(i), sha256=str(i)) for i, run in enumerate(runs)]
        found = compare_standing(runs, list("aaabbb"))
        alarms += found.verdict != "no_difference"
    assert alarms <= 10
    assert any("compare runs of equal length" in remark for remark in found.remarks)


def test_one_run_per_group_is_not_testable() -> None:
    rng = np.random.default_rng(5)
    runs = [standing(level + noise(rng, 200, 0.5), str(level)) for level in (5.0, 9.0, 14.0)]
    found = compare_standing(runs, ["low", "middle", "high"])
    assert found.verdict == "not_testable" and not found.differences
    assert [one.ci95 is not None and one.run_spread is None for one in found.levels] == [True] * 3
    assert any("the spread between runs is unknown" in remark for remark in found.remarks)


def test_a_load_of_a_robot_that_drives_is_no_ancillary_power() -> None:
    rng = np.random.default_rng(6)
    runs = [standing(np.abs(8.0 + 6.0 * noise(rng, 200, 0.9)), str(i)) for i in range(4)]
    found = compare_standing(runs, list("aabb"))
    assert {one.quantity for one in found.levels} == {"mean power"}
    assert any("if it drives" in remark for remark in found.remarks)


def test_what_else_differs_is_told() -> None:
    rng = np.random.default_rng(7)
    volts = (np.repeat([12.0, 11.0], 3) + 0.01 * rng.normal(size=6)).tolist()
    runs = [
        standing(9.0 + i // 3 + 0.1 * noise(rng, 200, 0.0), str(i), voltage_v=np.full(200, volt))
        for i, volt in enumerate(volts)
    ]
    found = compare_standing(runs, list("aaabbb"))
    assert found.verdict == "groups_differ"
    assert any(
        "the battery voltage differs too between b and a" in remark for remark in found.remarks
    )
    assert any("the order of the runs" in remark for remark in found.remarks)
    for i, run in enumerate(runs):
        run.channels["time_s"][:] += 1000.0 * i
    assert any(
        "in one stretch" in remark for remark in compare_standing(runs, list("aaabbb")).remarks
    )
    assert not any(
        "stretch" in remark
        for remark in compare_standing(runs[:3] + runs[3:], list("ababab")).remarks
    )


def test_power_and_current_are_not_mixed() -> None:
    power = standing(9.0 + noise(np.random.default_rng(8), 100, 0.0), "power")
    channels = {name: values for name, values in power.channels.items() if name != "power_w"}
    current = Recording("amps", "", channels | {"motor_left_a": power.channels["power_w"],
                                                "motor_right_a": np.zeros(100)})  # fmt: skip
    with pytest.raises(RecordingError, match="compare one kind"):
        compare_standing([power, current], ["a", "b"])


def drives(
    robot: Robot, seed: int, speeds: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> list[Recording]:
    """Three runs of a robot at these speeds."""
    levels = synthetic._levels
    with monkeypatch.context() as patch:
        patch.setattr(
            synthetic,
            "_levels",
            lambda rng, choices, *rest: levels(rng, speeds if 0.9 in choices else choices, *rest),
        )
        tables = [synthetic.record(robot, seed + run) for run in range(3)]
    return [
        Recording(
            f"{seed + i}.csv",
            str(seed + i),
            {str(c): table[c].to_numpy(dtype=float) for c in table},
        )
        for i, table in enumerate(tables)
    ]


def compared(recordings: list[Recording], robot: Robot, labels: str) -> Comparison:
    """Comparison of the groups by a refit of all runs, without a search for missing physics."""
    runs = average(usable_runs(recordings, robot)[0])
    fit = refit(runs, robot)
    known = tuple(estimates(fit, runs, independent_blocks(fit, runs).channels))
    residual = runs.observed - fit.predicted
    evidence = SimpleNamespace(
        runs=runs, model=fit, corrected=None, estimates=known, residual=residual, remaining=None
    )  # fmt: skip
    analysis = SimpleNamespace(
        evidence=evidence, findings=(), diagnosis=SimpleNamespace(verdict="model_adequate")
    )
    return compare_driving(cast(Analysis, analysis), recordings, list(labels))


def named(recordings: list[Recording], robot: Robot) -> list[str]:
    """Names of what differs between the first and the last three runs, in the order of the
    comparison."""
    differences = compared(recordings, robot, "aaabbb").differences
    assert [difference.quantity for difference in differences] == [
        "mean residual", "P_anc, idle part", "P_anc, per sample", "C_rr m / Gamma", "m / Gamma"
    ]  # fmt: skip  # no drag: at walking speed it is not identifiable
    return [difference.quantity for difference in differences if difference.named]


SLOW, FAST, ALL = (0.0, 0.2, 0.3, 0.4), (0.0, 0.6, 0.8, 0.9), (0.0, 0.3, 0.5, 0.7, 0.9)


def test_groups_that_are_only_driven_otherwise(
    husky: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in (0, 1000, 2000):
        runs = drives(husky, seed, SLOW, monkeypatch) + drives(husky, seed + 100, FAST, monkeypatch)
        assert named(runs, husky) == []


@pytest.mark.parametrize(
    ("change", "quantities"),
    [
        ({"rolling_resistance": 1.15}, ["mean residual", "C_rr m / Gamma"]),
        ({"controller_w": 1.5}, ["mean residual", "P_anc, idle part"]),
        # hills there and back: the same mean
        ({"mass_kg": 1.3, "rolling_resistance": 1.0 / 1.3}, ["m / Gamma"]),
    ],
)
def test_what_a_changed_robot_differs_in_is_named_from_drives(
    husky: Robot, monkeypatch: pytest.MonkeyPatch, change: dict[str, float], quantities: list[str]
) -> None:
    fields: dict[str, Any] = {
        name: factor * getattr(husky, name) for name, factor in change.items()
    }
    other = dataclasses.replace(husky, **fields)
    assert (
        named(drives(husky, 0, ALL, monkeypatch) + drives(other, 100, ALL, monkeypatch), husky)
        == quantities
    )


def steady_drives(rng: np.random.Generator, level_a: float) -> list[Recording]:
    """Three runs at one speed, which identify no parameter; the level varies by 0.35 A from run to
    run."""
    recordings: list[Recording] = []
    for _ in range(3):
        time_s = np.arange(0.0, 30.0, 0.1)
        current_a = level_a + rng.normal(0.0, 0.35) + 0.5 * noise(rng, len(time_s), 0.5)
        channels = {
            "time_s": time_s,
            "motor_left_a": 0.5 * current_a,
            "motor_right_a": 0.5 * current_a,
        }
        channels["wheel_left_mps"] = 0.8 + 0.02 * rng.normal(size=len(time_s))
        channels["wheel_right_mps"] = channels["wheel_left_mps"] + 0.004 * rng.normal(
            size=len(time_s)
        )
        name = f"{level_a:.0f} A, {len(recordings)}"
        recordings.append(Recording(name, name, channels))
    return recordings


def test_groups_differ_in_their_means_where_no_parameter_is_identifiable(husky: Robot) -> None:
    rng = np.random.default_rng(14)
    recordings = steady_drives(rng, 6.4) + steady_drives(rng, 9.8) + steady_drives(rng, 6.5)
    comparison = compared(recordings, husky, "aaabbbccc")
    pairs = {(one.group, one.minus): one for one in comparison.differences if one.named}
    assert set(pairs) == {("b", "a"), ("c", "b")}
    assert {one.quantity for one in comparison.differences} == {"mean residual"}
    assert pairs["b", "a"].value == pytest.approx(3.4, abs=0.8) and pairs["b", "a"].unit == "A"
    assert sum("not compared" in remark for remark in comparison.remarks) == 4
    same = [run for _ in range(2) for run in steady_drives(rng, 6.4)]
    assert compared(same, husky, "aaabbb").verdict == "no_difference"


def test_a_run_that_is_not_used_has_no_values(husky: Robot) -> None:
    recordings = steady_drives(np.random.default_rng(15), 6.4)
    short = {name: values[:5] for name, values in recordings[0].channels.items()}
    comparison = compared([*recordings, Recording("short", "short", short)], husky, "aaab")
    assert [run.values["mean residual"] is None for run in comparison.runs] == [
        False,
        False,
        False,
        True,
    ]
    assert comparison.verdict == "not_testable"


def test_the_mean_residual_counts_what_an_effect_that_changes_explains() -> None:
    terms = (
        SimpleNamespace(axis="steady", effect="turning"),
        SimpleNamespace(axis="time", effect="hidden_grade"),
    )
    corrected = SimpleNamespace(
        model=SimpleNamespace(terms=terms), contribution=(np.full(4, 9.0), np.arange(4.0))
    )
    runs = SimpleNamespace(
        run=np.array([0, 0, 1, 1]), duration_s=np.array([1.0, 3.0, 1.0, 1.0]), unit="W"
    )
    evidence = cast(
        Evidence,
        SimpleNamespace(runs=runs, corrected=corrected, residual=np.array([4.0, 0.0, 1.0, 2.0])),
    )
    ((quantity, means),) = mean_residual_of_runs(evidence).items()
    # (4 + 3 x 1) / 4 s, (3 + 5) / 2 s
    assert quantity.unit == "W" and means.tolist() == [1.75, 4.0]


def test_standing_groups_have_the_means_of_their_runs() -> None:
    rng = np.random.default_rng(9)
    powers = [level + noise(rng, 200, 0.5) for level in (5.0, 5.1, 9.0, 9.1)]
    found = compare_standing([standing(one, str(i)) for i, one in enumerate(powers)], list("aabb"))
    means = [float(one.mean()) for one in powers]
    assert [one.value for one in found.levels] == pytest.approx(
        [np.mean(means[:2]), np.mean(means[2:])]
    )
    (difference,) = found.differences
    assert difference.value == pytest.approx(np.mean(means[2:]) - np.mean(means[:2]))
    assert found.kind == "standing" and {one.unit for one in found.levels} == {"W"}
    assert [run.values["P_anc, idle part"] for run in found.runs] == pytest.approx(means)


def test_a_single_group_is_its_level_alone() -> None:
    rng = np.random.default_rng(10)
    runs = [standing(7.0 + noise(rng, 200, 0.5), str(i)) for i in range(3)]
    found = compare_standing(runs, ["a"] * 3)
    assert (
        len(found.levels) == 1 and not found.differences and "the mean of 3 runs" in found.summary
    )


COLUMNS = np.column_stack((np.ones(200), np.linspace(0.0, 1.0, 200), np.zeros(200)))


def test_steps_of_a_run_are_least_squares() -> None:
    residual = COLUMNS @ [0.4, -1.5, 0.0] + np.random.default_rng(11).normal(0.0, 0.1, 200)
    steps = of_runs._steps(COLUMNS, residual)
    np.testing.assert_allclose(steps[:2], np.linalg.lstsq(COLUMNS[:, :2], residual)[0])
    assert np.isnan(steps[2])  # what was not excited in this run


def test_steps_that_the_run_cannot_tell_are_none() -> None:
    rng = np.random.default_rng(12)
    residual = rng.normal(size=200)
    alike = np.column_stack((np.ones(200), 1.0 + 1e-4 * rng.normal(size=200)))
    assert np.isnan(of_runs._steps(alike, residual)).all()  # confounded
    assert np.isnan(of_runs._steps(np.ones((200, 2)), residual)).all()  # the same
    assert np.isnan(of_runs._steps(rng.normal(size=(2, 3)), residual[:2])).all()  # too short
    assert of_runs._steps(np.empty((200, 0)), residual).shape == (0,)
