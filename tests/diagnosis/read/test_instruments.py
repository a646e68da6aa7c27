"""Ordinary instruments: noise, steps, lags, held values and faults of logging make no physics of a clean robot."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.fit import usable
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.lags import without_drift
from homeward.diagnosis.fit.refit import estimates, refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.read.faults import without_faults
from homeward.diagnosis.read.noise import smoothed
from homeward.diagnosis.read.pitch import without_tilt
from homeward.diagnosis.read.signals import Signals, signals
from homeward.diagnosis.read.slope import slope_along
from homeward.physics import replay

Array = NDArray[np.float64]
Channels = dict[str, Array]
Spoil = Callable[[Channels, np.random.Generator], Channels]

STEP_S = 0.1
SAMPLES = 2500
ROBOTS = ("husky", "jackal")


def levels(rng: np.random.Generator, choices: tuple[float, ...], shortest_s: float, longest_s: float) -> Array:
    values, start = np.empty(SAMPLES), 0
    while start < SAMPLES:
        length = int(rng.uniform(shortest_s, longest_s) / STEP_S)
        values[start : start + length] = rng.choice(choices)
        start += length
    return values


def drive(robot: Robot, seed: int) -> Channels:
    """Out and back over hills with stops and turns, measured well; power follows by the kernel."""
    rng = np.random.default_rng(seed)
    time_s: Array = STEP_S * np.arange(SAMPLES, dtype=np.float64)
    top = robot.max_speed_mps
    speed = uniform_filter1d(levels(rng, (0.0, 0.3, 0.5, 0.7, 0.9), 4.0, 12.0), 15, mode="nearest") * top
    speed[speed < 0.02 * top] = 0.0
    path_m = np.concatenate(([0.0], np.cumsum(speed[:-1] * STEP_S)))
    place_m = path_m[-1] / 2.0 - np.abs(path_m - path_m[-1] / 2.0)
    waves_m, phases = np.array([35.0, 60.0, 90.0]) * top, rng.uniform(0.0, 2.0 * np.pi, 3)
    angle = 2.0 * np.pi * place_m[:, None] / waves_m + phases
    grade = np.arctan(0.035 * np.cos(angle).sum(axis=1)) * np.where(path_m > path_m[-1] / 2.0, -1.0, 1.0)
    yaw_rate = levels(rng, (0.0, 0.0, 0.3, -0.3, 0.6), 3.0, 9.0) * (speed > 0.0)
    power_w = replay(robot, time_s, speed, grade_rad=grade, yaw_rate_radps=yaw_rate).power_w
    return {
        "time_s": time_s,
        "speed_mps": speed + 0.003 * top * rng.normal(size=SAMPLES) * (speed > 0.0),
        "yaw_rate_radps": yaw_rate,
        "grade_rad": grade + 0.002 * rng.normal(size=SAMPLES),
        "elevation_m": (0.035 * np.sin(angle) * waves_m / (2.0 * np.pi)).sum(axis=1) + 0.02 * rng.normal(size=SAMPLES),
        "base_distance_m": place_m,
        "power_w": power_w + 0.02 * power_w.mean() * rng.normal(size=SAMPLES),
    }


@cache
def drives(name: str, effect: str = "", size: float = 0.0) -> tuple[Channels, ...]:
    robot = load_robot(name)
    effects = {effect: {"scrub" if effect == "turning" else "mass_factor": size}} if effect else {}
    return tuple(drive(dataclasses.replace(robot, effects=effects), 100 + index) for index in range(3))


def only(channels: Channels, *names: str) -> Channels:
    """Time, speed and power, and these."""
    return {name: channels[name] for name in ("time_s", "speed_mps", "yaw_rate_radps", "power_w", *names)}


def noisy(channels: Channels, name: str, size: float, rng: np.random.Generator) -> Channels:
    return {**channels, name: channels[name] + size * rng.normal(size=len(channels[name]))}


def held(channels: Channels, name: str, every: int) -> Channels:
    return {**channels, name: channels[name][np.arange(SAMPLES) // every * every]}


def late(channels: Channels, name: str, lag_s: float | Array) -> Channels:
    return {**channels, name: np.interp(channels["time_s"] - lag_s, channels["time_s"], channels[name])}


def charged(channels: Channels, rng: np.random.Generator) -> Channels:
    tail = {name: np.full(300, values[-1]) for name, values in channels.items()}
    tail["time_s"] = channels["time_s"][-1] + STEP_S * np.arange(1, 301)
    tail["speed_mps"] = tail["yaw_rate_radps"] = np.zeros(300)
    tail["power_w"] = rng.normal(-0.8, 0.02, 300) * channels["power_w"].mean()
    return {name: np.concatenate([values, tail[name]]) for name, values in channels.items()}


def silent(channels: Channels) -> Channels:
    """A meter that restarts while the robot drives, and shows nothing for 1.5 s."""
    driving = np.flatnonzero(np.convolve(np.abs(channels["speed_mps"]) > 0.1, np.ones(15), "valid") == 15.0)
    start = int(driving[len(driving) // 2])
    quiet = np.arange(len(channels["power_w"])) - start
    return {**channels, "power_w": np.where((quiet >= 0) & (quiet < 15), 0.0, channels["power_w"])}


def spiked(channels: Channels, rng: np.random.Generator) -> Channels:
    power = channels["power_w"].copy()
    power[np.append(rng.choice(SAMPLES - 1, 7, replace=False) + 1, 0)] *= rng.uniform(15.0, 40.0, 8)
    return {**channels, "power_w": power}


def recordings(name: str, spoil: Spoil, effect: str = "", size: float = 0.0) -> list[Recording]:
    return [
        Recording(f"run{index}.csv", str(index), spoil(channels, np.random.default_rng([100, index])))
        for index, channels in enumerate(drives(name, effect, size))
    ]


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
    assert analysis.diagnosis.verdict in ("no_mismatch", "parameters_off", "not_testable"), texts(analysis)
    assert said in texts(analysis)
    for one in analysis.diagnosis.parameters_off:
        assert one.fitted == pytest.approx(one.assumed, rel=0.15)


@pytest.mark.parametrize(
    ("trap", "effect", "size"), [("elevation, noise 0.5 m", "turning", 0.3), ("spikes", "inertia", 1.0)]
)
def test_a_true_effect_is_found_through_the_instrument(trap: str, effect: str, size: float) -> None:
    analysis = analyse(recordings("husky", SPOILT[trap][1], effect, size), "husky")
    named = {one.effect: one for one in analysis.diagnosis.missing_physics}
    assert list(named) == [effect]
    value = next(iter(named[effect].parameters.values()))
    assert value.value == pytest.approx(size, rel=0.2)


def test_hills_without_slopes_name_the_channel_that_lacks() -> None:
    analysis = analyse(recordings("husky", lambda c, rng: only(c)), "husky")
    summary = analysis.diagnosis.summary
    assert "slopes and the sensing rate that were not recorded (grade_rad or elevation_m" in summary
    assert "The robot file explains" not in summary


def test_a_recorded_payload_is_carried() -> None:
    husky, runs = load_robot("husky"), []
    for index, load_kg in enumerate((0.0, 10.0, 20.0)):
        loaded = dataclasses.replace(husky, effects={"payload": {"mass_kg": load_kg}} if load_kg else {})
        channels = only(drive(loaded, 100 + index), "grade_rad")
        runs.append(Recording(f"{index}", f"{index}", {**channels, "payload_kg": np.full(SAMPLES, load_kg)}))
    assert analyse(runs, husky).diagnosis.verdict == "no_mismatch"


def test_power_of_the_wrong_sign_and_of_another_robot_is_said() -> None:
    wrong = recordings("husky", lambda c, rng: {**only(c), "power_w": -c["power_w"]})[:1]
    assert "power drawn must be positive" in analyse(wrong, "husky").diagnosis.summary
    double = recordings("husky", lambda c, rng: {**only(c), "power_w": 3.0 * c["power_w"]})
    assert any("is this the right robot" in one.text for one in usable_runs(double, load_robot("husky"))[1])


@pytest.mark.parametrize("lacks", ["speed_mps", "power_w"])
def test_a_recording_without_motion_or_power_is_refused_in_a_line(lacks: str) -> None:
    spoilt = recordings("husky", lambda c, rng: {name: v for name, v in only(c).items() if name != lacks})
    diagnosis = analyse(spoilt, "husky").diagnosis
    assert diagnosis.verdict == "not_testable" and lacks in diagnosis.summary and "\n" not in diagnosis.summary


@pytest.mark.parametrize("name", ["grade_rad", "yaw_rate_radps", "payload_kg", "temperature_c", "heading_rad", "soc"])
def test_a_channel_without_values_is_as_good_as_none(name: str) -> None:
    spoilt = recordings("husky", lambda c, rng: {**only(c), name: np.full(SAMPLES, np.nan)})[:1]
    runs, findings = usable_runs(spoilt, load_robot("husky"))
    assert len(runs) == 1 and name not in runs[0].context
    assert any(one.text == f"{name} holds no values and is left out" for one in findings)


@pytest.mark.parametrize("count", [2, 3, 19, 60])
def test_a_few_samples_have_a_verdict(count: int) -> None:
    short = recordings("husky", lambda c, rng: {name: v[:count] for name, v in only(c, "grade_rad").items()})
    assert analyse(short[:1], "husky").diagnosis.verdict == "not_testable"


@pytest.mark.parametrize("seed", range(100, 103))
def test_the_slope_from_a_noisy_elevation_is_not_attenuated_and_its_error_is_known(seed: int) -> None:
    husky = load_robot("husky")
    channels = drive(husky, seed)
    elevation = channels["elevation_m"] + 0.5 * np.random.default_rng(seed).normal(size=SAMPLES)
    found = slope_along(elevation, channels["speed_mps"], np.full(SAMPLES - 1, STEP_S), 0.5)
    assert found is not None
    slope, error = found
    assert np.polyfit(slope, channels["grade_rad"], 1)[0] == pytest.approx(1.0, abs=0.15)
    assert error / 3.0 < float(np.std(slope - channels["grade_rad"])) < 2.0 * error


@pytest.mark.parametrize("size", [0.05, 0.2])
def test_noise_is_told_from_jumps(size: float) -> None:
    rng = np.random.default_rng(100)
    steps = np.repeat(rng.choice([0.0, 0.5, 1.0], 40), 50)
    found = smoothed(steps + size * rng.normal(size=2000), 1, jumps=True)
    assert found.noise == pytest.approx(size, rel=0.1)
    assert float(np.std(found.values - steps)) < 0.5 * size


def test_a_channel_that_is_smoothed_much_bears_no_parameter() -> None:
    spoilt = recordings("husky", lambda c, rng: noisy(only(c, "elevation_m"), "elevation_m", 8.0, rng))
    runs = average(usable_runs(spoilt, load_robot("husky"))[0])
    fit = refit(runs, load_robot("husky"))
    mass = next(one for one in estimates(fit, runs, cut_blocks(runs.run)) if one.group.name == "mass")
    assert mass.status in ("too uncertain", "not excited") and mass.fitted is None


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("tilt_deg", [0.0, -2.0])
def test_a_tilted_sensor_is_known_by_a_closed_way(name: str, tilt_deg: float) -> None:
    tilted = recordings(name, lambda c, rng: {**c, "grade_rad": c["grade_rad"] + np.radians(tilt_deg)})
    level, angle = without_tilt([signals(one, load_robot(name)) for one in tilted])
    assert np.degrees(angle) == pytest.approx(tilt_deg, abs=0.1)
    left_rad = np.radians(tilt_deg) - angle
    assert abs(left_rad) < 3.0 * level[0].tilt_error_rad


@pytest.mark.parametrize(("error_deg", "verdict"), [(0.0, "parameters_off"), (0.2, "no_mismatch")])
def test_what_a_tilt_may_leave_is_no_wrong_parameter(
    error_deg: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def uncorrected(runs: Sequence[Signals]) -> tuple[list[Signals], float]:
        return [dataclasses.replace(run, tilt_error_rad=np.radians(error_deg)) for run in runs], 0.0

    monkeypatch.setattr(usable, "without_tilt", uncorrected)
    tilted = recordings("husky", lambda c, rng: {**only(c, "grade_rad"), "grade_rad": c["grade_rad"] + np.radians(0.3)})
    analysis = analyse(tilted, "husky")
    assert analysis.diagnosis.verdict == verdict
    rolling = next(one for one in analysis.diagnosis.parameters if one.group == "C_rr m / Gamma")
    assert rolling.assumed is not None
    assert (rolling.ci95[0] <= rolling.assumed <= rolling.ci95[1]) == bool(error_deg)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("drift_s", [0.0, 0.4, 2.0])
def test_a_drifting_clock_is_set_right(name: str, drift_s: float) -> None:
    runs = recordings(name, lambda c, rng: late(only(c, "grade_rad"), "power_w", drift_s * c["time_s"] / 250.0))
    robot = load_robot(name)
    _, drifts = without_drift([signals(one, robot) for one in runs], robot)
    assert len(drifts) == (3 if drift_s else 0)
    assert all(found == pytest.approx(drift_s, abs=0.2) for found in drifts.values())


def test_the_spikes_of_starts_are_the_robots_own() -> None:
    husky = load_robot("husky")
    channels = only(drives("husky")[0])
    moves = channels["speed_mps"] > 0.02
    starts = np.flatnonzero(moves[1:] & ~moves[:-1]) + 1
    power = channels["power_w"].copy()
    power[starts] *= 20.0
    kept, _ = without_faults(Recording("a", "0", {**channels, "power_w": power}), husky)
    assert np.isfinite(kept.channels["power_w"]).all() and len(starts) > 3


def test_bursts_of_energy_at_starts_are_neither_spikes_nor_a_drifting_clock() -> None:
    """Also of a robot that sets off slowly, whose speed is within its noise for the first half second."""
    true = dataclasses.replace(load_robot("jackal"), effects={"breakaway": {"start_j": 150.0}})
    runs, burst_w = [], 150.0 / STEP_S
    for seed in range(3):
        rng, time_s = np.random.default_rng(seed), np.linspace(0.0, 249.9, SAMPLES)
        speed: Array = np.clip(0.6 * np.sin(time_s / 7.0 + rng.uniform()), 0.0, None)
        power_w = replay(true, time_s, speed).power_w + rng.normal(size=SAMPLES)
        recorded: Array = np.where(speed > 0.0, speed + 0.01 * rng.normal(size=SAMPLES), 0.0)
        runs.append(Recording(str(seed), str(seed), {"time_s": time_s, "speed_mps": recorded, "power_w": power_w}))
    usable, findings = usable_runs(runs, load_robot("jackal"))
    assert not any("spike" in one.text or "clock" in one.text for one in findings)
    for run in usable:
        sets_off = np.flatnonzero((run.speed_mps[:-1] == 0.0) & (run.speed_mps[1:] > 0.0)) + 1
        assert sets_off.tolist() == np.flatnonzero(run.observed > 0.5 * burst_w).tolist()


def test_levels_that_are_set_are_not_taken_for_held_readings() -> None:
    rng = np.random.default_rng(100)
    levels_set = np.repeat(rng.choice([0.0, 0.3, 0.6, 0.9], SAMPLES // 10), 10)
    channels = {**only(drives("husky")[0]), "speed_mps": levels_set}
    kept, _ = without_faults(Recording("a", "0", channels), load_robot("husky"))
    np.testing.assert_array_equal(kept.channels["speed_mps"], levels_set)


def test_a_held_speed_is_known_before_its_first_change_and_after_its_last() -> None:
    channels = only(drives("husky")[0])
    speed = np.where((channels["time_s"] > 20.0) & (channels["time_s"] < 230.0), 0.3 + channels["time_s"] / 1000.0, 0.0)
    spoilt = held({**channels, "speed_mps": speed}, "speed_mps", 10)
    kept, _ = without_faults(Recording("a", "0", spoilt), load_robot("husky"))
    np.testing.assert_allclose(kept.channels["speed_mps"], speed, atol=0.51)
    assert not kept.channels["speed_mps"][:190].any() and not kept.channels["speed_mps"][2320:].any()
