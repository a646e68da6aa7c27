"""What is wrong with a recording is said in one line, and what can be used is used."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.usable import fault_of, usable_runs
from homeward.diagnosis.read.signals import signals
from homeward.logs.channels import Array
from tests.diagnosis.hills import Channels, drives, only, recordings

Spoil = Callable[[Channels], Channels]


def drive() -> Channels:
    return only(drives("husky")[0], "grade_rad")


def recording(channels: Channels, name: str = "run.csv") -> Recording:
    return Recording(name, name, channels)


def said(channels: Channels, husky: Robot) -> list[str]:
    """Remarks on a recording that is used."""
    runs, findings = usable_runs([recording(channels)], husky)
    assert len(runs) == 1 and not any(one.refused for one in findings)
    assert all("\n" not in one.text for one in findings)
    return [one.text for one in findings]


def without(channels: Channels, *names: str) -> Channels:
    return {name: values for name, values in channels.items() if name not in names}


def amperes(channels: Channels) -> Channels:
    """Motor current instead of power."""
    current_a = 0.01 * channels["power_w"]
    return {**without(channels, "power_w"), "motor_left_a": current_a, "motor_right_a": current_a}


def shortened(channels: Channels, chosen: slice) -> Channels:
    return {name: values[chosen] for name, values in channels.items()}


REFUSED: dict[str, tuple[Spoil, str]] = {
    "sign flip": (lambda of: {**of, "power_w": -of["power_w"]}, "power drawn must be positive (factor -1"),
    "dead": (lambda of: {**of, "power_w": 0.0 * of["power_w"]}, "zero throughout; was the sensor connected?"),
    "hung": (lambda of: {**of, "power_w": 0.0 * of["power_w"] + 61.0}, "never changes (61 W); did the logger hang?"),
    "milliwatts": (lambda of: {**of, "power_w": 1e3 * of["power_w"]}, "this looks like milliwatts"),
    "kilowatts": (lambda of: {**of, "power_w": 1e-3 * of["power_w"]}, "this looks like kilowatts"),
    "km/h": (lambda of: {**of, "speed_mps": 3.6 * of["speed_mps"]}, "another robot or another unit; km/h?"),
    "a car": (lambda of: {**of, "speed_mps": 30.0 * of["speed_mps"]}, "another robot or another unit"),
    "no motion": (lambda of: without(of, "speed_mps"), "has no motion channel (speed_mps or wheel_left_mps"),
    "no power": (lambda of: without(of, "power_w"), "has no power channel (power_w or voltage_v"),
    "short": (lambda of: shortened(of, slice(40)), "is too short (40 samples over 3.9 s)"),
    "few": (lambda of: shortened(of, slice(0, 2500, 132)), "is too short (19 samples over 238 s)"),
    "rows of their own": (
        lambda of: {**of, "power_w": np.where(np.arange(2500) % 4 == 0, of["power_w"], np.nan)}, "missing in 75% of",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", REFUSED)
def test_a_recording_that_cannot_be_used_is_refused_in_one_line(fault: str, husky: Robot) -> None:
    spoil, why = REFUSED[fault]
    runs, findings = usable_runs([recording(spoil(drive()))], husky)
    (finding,) = (one for one in findings if one.refused)
    assert runs == [] and why in finding.text and "\n" not in finding.text
    assert fault != "a car" or "km/h" not in finding.text


def test_twenty_samples_are_enough(husky: Robot) -> None:
    (run,), _ = usable_runs([recording(shortened(drive(), slice(0, 2500, 130)))], husky)
    assert len(run.time_s) == 20


@pytest.mark.parametrize("fault", ["sign flip", "dead", "hung", "milliwatts", "km/h"])
def test_a_run_is_known_by_the_same_faults_as_its_recording(fault: str, husky: Robot) -> None:
    spoil, why = REFUSED[fault]
    assert fault_of(signals(recording(drive()), husky), husky) is None
    assert why in str(fault_of(signals(recording(spoil(drive())), husky), husky))


def test_a_faultless_recording_has_no_remark(husky: Robot) -> None:
    assert said(drive(), husky) == []


def cut(channels: Channels) -> Channels:
    kept = np.abs(channels["time_s"] - 100.0) > 6.0
    return {name: values[kept] for name, values in channels.items()}


def holes(name: str) -> Spoil:
    return lambda of: {**of, name: np.where(np.arange(2500) % 250 == 7, np.nan, of[name])}


def coarse(channels: Channels) -> Channels:
    rng = np.random.default_rng(0)
    return {**without(channels, "grade_rad"), "elevation_m": 100.0 + rng.standard_normal(2500)}


REMARKS: dict[str, tuple[Spoil, str]] = {
    "gap": (cut, "1 gaps, the longest 12.2 s where the median step is 0.1 s"),
    "power missing": (holes("power_w"), "10 samples without motion or power are left out"),
    "slope missing": (holes("grade_rad"), "missing values of grade_rad are interpolated"),
    "noisy height": (
        coarse, "slopes from elevation_m are no larger than their error: they are treated as unknown",
    ),
    "one speed": (
        lambda of: {**of, "speed_mps": np.full(2500, 0.5)},
        "the speed hardly changes: idle power, rolling resistance and drag are confounded",
    ),
    "parked": (
        lambda of: {**of, "speed_mps": np.zeros(2500), "yaw_rate_radps": np.zeros(2500)},
        "the robot stands throughout: the parameters of its drive are not identifiable",
    ),
    "amperes": (amperes, "motor current without voltage: torque only, so power, energy and range are not known"),
}  # fmt: skip


@pytest.mark.parametrize("what", REMARKS)
def test_what_a_recording_lacks_is_said_in_one_line(what: str, husky: Robot) -> None:
    spoil, remark = REMARKS[what]
    assert remark in said(spoil(drive()), husky)


def test_samples_that_are_left_out_are_in_no_run(husky: Robot) -> None:
    (run,), _ = usable_runs([recording(holes("power_w")(drive()))], husky)
    assert len(run.time_s) == 2490 and np.isfinite(run.observed).all()


def test_the_same_recording_counts_once(husky: Robot) -> None:
    one = recording(drive())
    runs, (finding,) = usable_runs([one, dataclasses.replace(one, name="copy.csv")], husky)
    assert [run.name for run in runs] == ["run.csv"]
    assert (finding.recording, finding.text, finding.refused) == (
        "copy.csv",
        "is the same as run.csv",
        True,
    )


def test_power_is_preferred_to_current_whichever_comes_first(husky: Robot) -> None:
    both = [recording(amperes(drive()), "a.csv"), recording(drive(), "w.csv")]
    for given in (both, both[::-1]):
        runs, findings = usable_runs(given, husky)
        assert [run.name for run in runs] == ["w.csv"]
        assert [one.recording for one in findings if one.refused] == ["a.csv"]


def test_a_channel_that_only_some_runs_have_is_named(husky: Robot) -> None:
    sensing_hz: Array = np.tile([0.0, 10.0], 1250)
    given = [recording({**drive(), "sensing_hz": sensing_hz}, "a.csv"), recording(drive(), "b.csv")]
    texts = {one.recording: one.text for one in usable_runs(given, husky)[1]}
    assert texts == {
        "b.csv": "lacks sensing_hz, which other runs have; its sensing rate is assumed to be 0"
    }


@pytest.mark.parametrize(("factor", "asks"), [(1.5, False), (3.0, True), (0.3, True)])
def test_a_robot_that_draws_far_more_or_less_than_its_file_says_may_be_another(
    factor: float, asks: bool, husky: Robot
) -> None:
    texts = said({**drive(), "power_w": factor * drive()["power_w"]}, husky)
    assert any("is this the right robot" in one for one in texts) == asks


def test_a_motor_current_asks_for_no_other_robot_where_the_thrust_of_an_ampere_is_unknown(
    husky: Robot,
) -> None:
    unknown = dataclasses.replace(husky, traction_n_per_a=0.0)
    assert not any("is this the right robot" in text for text in said(amperes(drive()), unknown))


def test_of_several_runs_the_sensor_and_the_clock_are_mended(husky: Robot) -> None:
    """A slope that is tilted, and a clock of power that falls back."""
    late = recordings("husky", lambda of, rng: {
        **of, "grade_rad": of["grade_rad"] + 0.02,
        "power_w": np.interp(of["time_s"] - of["time_s"] / 125.0, of["time_s"], of["power_w"]),
    })  # fmt: skip
    runs, findings = usable_runs(late[:2], husky)
    texts = [one.text for one in findings]
    assert sum("the sensor is tilted" in one for one in texts) == 1
    assert (
        sum("the clock of power falls back by 2 s against that of motion" in one for one in texts)
        == 2
    )
    (plain, *_), _ = usable_runs(recordings("husky", lambda of, rng: of)[:1], husky)
    assert float(np.mean(runs[0].grade_rad - plain.grade_rad)) == pytest.approx(0.0, abs=2e-3)
    assert np.corrcoef(runs[0].observed, plain.observed)[0, 1] > 0.99
