"""Verdicts on recordings whose truth is known."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Analysis, Recording, RecordingError, analyse, diagnose
from homeward.diagnosis.fit.estimates import Estimate
from homeward.physics import replay
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]


def group(analysis: Analysis, name: str) -> Estimate:
    """The estimate of a group."""
    assert analysis.evidence is not None
    return next(one for one in analysis.evidence.estimates if one.group.name == name)


def with_channels(recording: Recording, **channels: np.ndarray) -> Recording:
    """The recording with channels replaced or added."""
    return dataclasses.replace(recording, channels={**recording.channels, **channels})


def test_a_robot_that_is_as_its_file_says_has_no_mismatch(
    faultless: Analysis, husky: Robot
) -> None:
    assert faultless.diagnosis.verdict == "no_mismatch"
    assert faultless.corrected == husky
    assert faultless.diagnosis.parameters_off == () and faultless.diagnosis.where == ()
    assert faultless.diagnosis.range_change_m == 0.0


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_mis_set_rolling_resistance_is_a_parameter_and_not_physics(
    short_drive: Drive, husky: Robot, factor: float
) -> None:
    true = factor * husky.rolling_resistance
    analysis = analyse(short_drive(husky, rolling_resistance=true), husky)
    assert analysis.diagnosis.verdict == "parameters_off"
    off = {one.group: one for one in analysis.diagnosis.parameters_off}["C_rr m / Gamma"]
    assert off.ci95[0] <= true * husky.mass_kg / husky.traction_efficiency <= off.ci95[1]
    assert analysis.corrected.rolling_resistance * analysis.corrected.mass_kg == pytest.approx(
        true * husky.mass_kg, rel=0.03
    )
    assert analysis.diagnosis.fit is not None
    arms = analysis.diagnosis.fit.arms
    assert arms["refit"].rmse_ci95[1] < arms["nominal"].rmse_ci95[0]
    change_m = analysis.diagnosis.range_change_m
    assert change_m is not None and np.sign(change_m) == np.sign(1.0 - factor)


def test_power_that_changes_at_standstill_is_unknown_and_at_no_place(husky: Robot) -> None:
    time_s = np.arange(1200) / 10.0
    channels = {
        "time_s": time_s,
        "speed_mps": np.zeros(1200),
        "power_w": 120.0 + 50.0 * np.sin(time_s / 6.0),
    }
    found = diagnose(Recording("run", "", channels), husky)
    assert (found.verdict, found.where) == ("unknown_physics", ())
    assert "no stretch of time stands out" in found.summary and "nan" not in found.summary
    assert found.next_experiment is None


def test_concealed_turning_is_missing_physics_located_at_turning(scrubbing: Analysis) -> None:
    diagnosis = scrubbing.diagnosis
    assert diagnosis.verdict == "missing_physics"
    assert all("turning faster than" in place.condition for place in diagnosis.where)
    assert sum(place.share_of_excess for place in diagnosis.where) > 0.7


def test_concealed_wind_is_named_and_located_by_heading(short_drive: Drive, husky: Robot) -> None:
    fast = dataclasses.replace(husky, drag_ns2_per_m2=8.0)
    runs = []
    for seed, run in enumerate(short_drive(fast)):
        time_s, speed = run.channels["time_s"], run.channels["speed_mps"]
        heading = np.pi * (np.arange(len(time_s)) // 400 % 2)
        wind = replay(fast, time_s, speed, headwind_mps=0.0).drive_w
        gust = replay(fast, time_s, speed, headwind_mps=2.0 * np.cos(heading)).drive_w
        extra = (
            8.0 * ((np.maximum(speed + 2.0 * np.cos(heading), 0.0)) ** 2 - speed**2) * speed / 0.7
        )
        assert np.array_equal(wind, gust)  # the model file knows no wind
        power = (
            run.channels["power_w"] + extra + np.random.default_rng(seed).normal(size=len(extra))
        )
        runs.append(with_channels(run, heading_rad=heading, power_w=power))
    diagnosis = diagnose(runs, fast)
    named = diagnosis.missing_physics[0]
    assert named.effect == "wind" and ends(named.parameters["from_ahead_mps"])[0] > 0.5
    assert all("heading" in place.condition for place in diagnosis.where)


def test_constant_speed_and_a_short_log_test_nothing(husky: Robot) -> None:
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 40.0, 0.1)
    speed = np.full(len(time_s), 0.5)
    short = Recording(
        "short", "0", {"time_s": time_s, "speed_mps": speed, "power_w": 100 + rng.normal(size=400)}
    )
    diagnosis = diagnose([short], husky)
    assert diagnosis.verdict == "not_testable" and "too short" in diagnosis.summary
    assert diagnosis.next_experiment is not None
    time_s = np.arange(0.0, 600.0, 0.1)
    power = 130.0 + rng.normal(size=6000)
    long = Recording(
        "long", "1", {"time_s": time_s, "speed_mps": np.full(6000, 0.5), "power_w": power}
    )
    analysis = analyse([long], husky)
    assert analysis.diagnosis.verdict == "not_testable"
    assert analysis.evidence is not None
    assert all(one.fitted is None for one in analysis.evidence.estimates)
    assert analysis.corrected == husky


def test_constant_speed_with_jitter_is_no_excitation(husky: Robot) -> None:
    rng = np.random.default_rng(1)
    speed = 0.5 + 0.01 * rng.normal(size=6000)
    power = 100.0 + rng.normal(size=6000)
    run = Recording(
        "run", "0", {"time_s": np.arange(6000) / 10.0, "speed_mps": speed, "power_w": power}
    )
    assert diagnose([run], husky).verdict == "not_testable"


def test_what_was_not_excited_is_not_a_number(short_drive: Drive, husky: Robot) -> None:
    flat = []
    for run in short_drive(husky):  # power of a flat drive without sensing
        power = (
            60.0
            + 98.8 * run.channels["speed_mps"]
            + np.random.default_rng(int(run.sha256)).normal(size=len(run))
        )
        nothing = np.zeros(len(run))
        flat.append(with_channels(run, grade_rad=nothing, sensing_hz=nothing, power_w=power))
    analysis = analyse(flat, husky)
    for name in ("mass", "sample_energy"):
        assert group(analysis, name).status == "not excited"
        assert group(analysis, name).fitted is None
    assert group(analysis, "rolling").fitted is not None


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda run: with_channels(run, power_w=np.zeros(len(run))), "zero throughout"),
        (lambda run: with_channels(run, power_w=np.full(len(run), 50.0)), "never changes"),
        (lambda run: with_channels(run, power_w=1000.0 * run.channels["power_w"]), "milliwatts"),
        (lambda run: with_channels(run, power_w=run.channels["power_w"] / 1000.0), "kilowatts"),
        (lambda run: with_channels(run, speed_mps=3.6 * run.channels["speed_mps"]), "km/h?"),
        (
            lambda run: with_channels(run, power_w=np.where(np.arange(len(run)) % 3, np.nan, 1.0)),
            "missing in 67%",
        ),
        (
            lambda run: dataclasses.replace(
                run, channels={k: v[:30] for k, v in run.channels.items()}
            ),
            "too short",
        ),
    ],
)
def test_runs_that_cannot_be_used_are_set_aside(
    short_drive: Drive, husky: Robot, spoil: Callable[[Recording], Recording], said: str
) -> None:
    (bad,) = short_drive(husky, runs=1)
    alone = diagnose([spoil(bad)], husky)
    assert alone.verdict == "not_testable" and said in alone.summary and alone.fit is None


def test_runs_beside_those_that_cannot_be_used_are_diagnosed(
    short_drive: Drive, husky: Robot
) -> None:
    good, dead, milli = short_drive(husky, runs=3)
    dead = with_channels(dead, power_w=np.zeros(len(dead)))
    milli = with_channels(milli, power_w=1000.0 * milli.channels["power_w"])
    diagnosis = diagnose([good, dead, milli], husky)
    assert [one.path for one in diagnosis.recordings] == [good.name]
    assert "2 of the runs excluded (run1.csv the recorded power" in diagnosis.summary
    assert "zero throughout" in diagnosis.summary


def test_the_same_run_twice_counts_once(short_drive: Drive, husky: Robot) -> None:
    (run,) = short_drive(husky, runs=1)
    copy = dataclasses.replace(run, name="copy.csv")
    diagnosis = diagnose([run, copy], husky)
    assert len(diagnosis.recordings) == 1 and "is the same as run0.csv" in diagnosis.summary


def test_no_recordings(husky: Robot) -> None:
    with pytest.raises(RecordingError, match="no recordings"):
        diagnose([], husky)


def test_the_same_input_gives_the_same_verdict(
    scrubbing: Analysis, short_drive: Drive, husky: Robot
) -> None:
    again = diagnose(short_drive(husky, effects={"turning": {"scrub": 0.3}}), husky)
    assert again.to_json() == scrubbing.diagnosis.to_json()
