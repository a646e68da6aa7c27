"""Ordinary instruments: noise, steps, lags, held values and faults of logging make no physics of a
clean robot."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from homeward import load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.fit import usable
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.read.signals import Signals
from homeward.physics import replay
from tests.diagnosis.hills import (
    SAMPLES,
    STEP_S,
    Array,
    Channels,
    Spoil,
    drive,
    held,
    late,
    noisy,
    only,
    recordings,
)


def charged(channels: Channels, rng: np.random.Generator) -> Channels:
    tail = {name: np.full(300, values[-1]) for name, values in channels.items()}
    tail["time_s"] = channels["time_s"][-1] + STEP_S * np.arange(1, 301)
    tail["speed_mps"] = tail["yaw_rate_radps"] = np.zeros(300)
    tail["power_w"] = rng.normal(-0.8, 0.02, 300) * channels["power_w"].mean()
    return {name: np.concatenate([values, tail[name]]) for name, values in channels.items()}


def silent(channels: Channels) -> Channels:
    """A meter that restarts while the robot drives, and shows nothing for 1.5 s."""
    driving = np.flatnonzero(
        np.convolve(np.abs(channels["speed_mps"]) > 0.1, np.ones(15), "valid") == 15.0
    )
    start = int(driving[len(driving) // 2])
    quiet = np.arange(len(channels["power_w"])) - start
    return {**channels, "power_w": np.where((quiet >= 0) & (quiet < 15), 0.0, channels["power_w"])}


def spiked(channels: Channels, rng: np.random.Generator) -> Channels:
    power = channels["power_w"].copy()
    power[np.append(rng.choice(SAMPLES - 1, 7, replace=False) + 1, 0)] *= rng.uniform(15.0, 40.0, 8)
    return {**channels, "power_w": power}


SPOILT: dict[str, tuple[str, Spoil, str]] = {
    "elevation, noise 0.5 m": (
        "husky", lambda c, rng: noisy(only(c, "elevation_m"), "elevation_m", 0.5, rng), ""),
    "elevation, steps of 1 m": (
        "jackal", lambda c, rng: {**only(c, "elevation_m"), "elevation_m": np.round(c["elevation_m"])}, ""),
    "elevation, 10 s late": (
        "husky", lambda c, rng: late(only(c, "elevation_m"), "elevation_m", 10.0), "s late against power"),
    "grade, noise 0.7 degrees": (
        "jackal", lambda c, rng: noisy(only(c, "grade_rad"), "grade_rad", np.radians(0.7), rng), ""),
    "grade, tilted": (
        "husky", lambda c, rng: {**c, "grade_rad": c["grade_rad"] + np.radians(1.5)}, "+1.5 degrees"),
    "speed, noise": (
        "jackal", lambda c, rng: noisy(only(c, "grade_rad"), "speed_mps", 0.09, rng), ""),
    "speed, held": (
        "husky", lambda c, rng: held(only(c, "grade_rad"), "speed_mps", 10), "speed_mps is held for 1"),
    "power, held": (
        "jackal", lambda c, rng: held(only(c, "grade_rad"), "power_w", 10), "power_w is held for 1"),
    "clock drifts": (
        "husky", lambda c, rng: late(only(c, "grade_rad"), "power_w", c["time_s"] / 250.0), "falls back by"),
    "charging": ("jackal", lambda c, rng: charged(only(c, "grade_rad"), rng), "charging is left out"),
    "spikes": ("husky", lambda c, rng: spiked(only(c, "grade_rad"), rng), "8 spikes of power_w"),
    "meter silent": ("jackal", lambda c, rng: silent(only(c, "grade_rad")), "power reads exactly zero in 15 samples"),
    "slow log": (
        "jackal", lambda c, rng: {name: v[::10] for name, v in only(c, "grade_rad").items()}, ""),
}  # fmt: skip


def texts(analysis: Analysis) -> str:
    return " / ".join([analysis.diagnosis.summary, *(one.text for one in analysis.findings)])


@pytest.mark.parametrize("trap", SPOILT)
def test_an_ordinary_instrument_makes_no_physics(trap: str) -> None:
    name, spoil, said = SPOILT[trap]
    analysis = analyse(recordings(name, spoil), name)
    assert analysis.diagnosis.missing_physics == ()
    assert analysis.diagnosis.verdict in ("no_mismatch", "parameters_off", "not_testable"), texts(
        analysis
    )
    assert said in texts(analysis)
    for one in analysis.diagnosis.parameters_off:
        assert one.fitted == pytest.approx(one.assumed, rel=0.15)


@pytest.mark.parametrize(
    ("trap", "effect", "size"),
    [("elevation, noise 0.5 m", "turning", 0.3), ("spikes", "inertia", 1.0)],
)
def test_a_true_effect_is_found_through_the_instrument(trap: str, effect: str, size: float) -> None:
    analysis = analyse(recordings("husky", SPOILT[trap][1], effect, size), "husky")
    named = {one.effect: one for one in analysis.diagnosis.missing_physics}
    assert list(named) == [effect]
    value = next(iter(named[effect].parameters.values()))
    assert value.value == pytest.approx(size, rel=0.2)


def test_a_recorded_payload_is_carried() -> None:
    husky, runs = load_robot("husky"), []
    for index, load_kg in enumerate((0.0, 10.0, 20.0)):
        loaded = dataclasses.replace(
            husky, effects={"payload": {"mass_kg": load_kg}} if load_kg else {}
        )
        channels = only(drive(loaded, 100 + index), "grade_rad")
        runs.append(
            Recording(f"{index}", f"{index}", {**channels, "payload_kg": np.full(SAMPLES, load_kg)})
        )
    assert analyse(runs, husky).diagnosis.verdict == "no_mismatch"


def test_power_of_the_wrong_sign_and_of_another_robot_is_said() -> None:
    wrong = recordings("husky", lambda c, rng: {**only(c), "power_w": -c["power_w"]})[:1]
    assert "power drawn must be positive" in analyse(wrong, "husky").diagnosis.summary
    double = recordings("husky", lambda c, rng: {**only(c), "power_w": 3.0 * c["power_w"]})
    assert any(
        "is this the right robot" in one.text for one in usable_runs(double, load_robot("husky"))[1]
    )


@pytest.mark.parametrize("lacks", ["speed_mps", "power_w"])
def test_a_recording_without_motion_or_power_is_refused_in_a_line(lacks: str) -> None:
    spoilt = recordings(
        "husky", lambda c, rng: {name: v for name, v in only(c).items() if name != lacks}
    )
    diagnosis = analyse(spoilt, "husky").diagnosis
    assert (
        diagnosis.verdict == "not_testable"
        and lacks in diagnosis.summary
        and "\n" not in diagnosis.summary
    )


@pytest.mark.parametrize("count", [2, 3, 19, 60])
def test_a_few_samples_have_a_verdict(count: int) -> None:
    short = recordings(
        "husky", lambda c, rng: {name: v[:count] for name, v in only(c, "grade_rad").items()}
    )
    assert analyse(short[:1], "husky").diagnosis.verdict == "not_testable"


@pytest.mark.parametrize(("error_deg", "verdict"), [(0.0, "parameters_off"), (0.2, "no_mismatch")])
def test_what_a_tilt_may_leave_is_no_wrong_parameter(
    error_deg: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def uncorrected(runs: Sequence[Signals]) -> tuple[list[Signals], float]:
        return [dataclasses.replace(run, tilt_error_rad=np.radians(error_deg)) for run in runs], 0.0

    monkeypatch.setattr(usable, "without_tilt", uncorrected)
    tilted = recordings(
        "husky",
        lambda c, rng: {**only(c, "grade_rad"), "grade_rad": c["grade_rad"] + np.radians(0.3)},
    )
    analysis = analyse(tilted, "husky")
    assert analysis.diagnosis.verdict == verdict
    rolling = next(one for one in analysis.diagnosis.parameters if one.group == "C_rr m / Gamma")
    assert rolling.assumed is not None
    assert (rolling.ci95[0] <= rolling.assumed <= rolling.ci95[1]) == bool(error_deg)


def test_bursts_of_energy_at_starts_are_neither_spikes_nor_a_drifting_clock() -> None:
    """Also of a robot that sets off slowly, whose speed is within its noise for the first half
    second."""
    true = dataclasses.replace(load_robot("jackal"), effects={"breakaway": {"start_j": 150.0}})
    runs, burst_w = [], 150.0 / STEP_S
    for seed in range(3):
        rng, time_s = np.random.default_rng(seed), np.linspace(0.0, 249.9, SAMPLES)
        speed: Array = np.clip(0.6 * np.sin(time_s / 7.0 + rng.uniform()), 0.0, None)
        power_w = replay(true, time_s, speed).power_w + rng.normal(size=SAMPLES)
        recorded: Array = np.where(speed > 0.0, speed + 0.01 * rng.normal(size=SAMPLES), 0.0)
        runs.append(
            Recording(
                str(seed), str(seed), {"time_s": time_s, "speed_mps": recorded, "power_w": power_w}
            )
        )
    usable, findings = usable_runs(runs, load_robot("jackal"))
    assert not any("spike" in one.text or "clock" in one.text for one in findings)
    for run in usable:
        sets_off = np.flatnonzero((run.speed_mps[:-1] == 0.0) & (run.speed_mps[1:] > 0.0)) + 1
        assert sets_off.tolist() == np.flatnonzero(run.observed > 0.5 * burst_w).tolist()
