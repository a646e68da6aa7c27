"""What a robot reads of itself: errors of the sizes documented, the same for the same key, and what
is made of them."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.envs.conditions.instruments import (
    INSTRUMENTS,
    InstrumentError,
    Instruments,
    load_instruments,
)
from homeward.envs.features import FEATURES, INDEX
from homeward.envs.options import OptionError, Options, known_of
from homeward.envs.routes import Route
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import load_robot
from homeward.physics.battery import energy_share
from homeward.physics.robot import preset_names
from tests.envs.rollouts import MISSIONS, feature, make, mission

MANY, DECISIONS = 1000, 60
ERRING = ("meter", "gauge")


def error(deviation: float, count: int) -> float:
    """Four standard errors of a mean."""
    return 4.0 * deviation / math.sqrt(count)


class Readings:
    """Many missions at any speeds and rates: what is so and what is read, arrays of shape
    (decisions, missions)."""

    def __init__(self, instruments: str | Instruments, count: int = MANY, **options: Any) -> None:
        self.sizes = load_instruments(instruments)
        envs = HomewardVectorEnv(count, mission="Survey", instruments=instruments, **options)
        envs.reset(seed=0)
        batch, rng = envs.batch, np.random.default_rng(0)
        self.shared, self.records = batch.known.shared[0], batch.records
        observations = np.zeros((count, len(FEATURES)), np.float32)
        rewards, terminated, truncated = (
            np.zeros(count),
            np.zeros(count, np.bool_),
            np.zeros(count, np.bool_),
        )
        self.start = batch.records.copy()
        states = []
        for _ in range(DECISIONS):
            actions = np.column_stack((rng.integers(0, 5, (count, 2)), np.full(count, GO)))
            batch.step(actions, observations, rewards, terminated, truncated)
            assert not terminated.any()
            states.append(batch.records.copy())
        self.states: NDArray[np.void] = np.array(states)
        start_j: NDArray[np.float64] = self.start["energy_j"]
        after_j: NDArray[np.float64] = self.states["energy_j"]
        energies_j = np.concatenate((start_j[None], after_j))
        self.power_w = -np.diff(energies_j, axis=0) / self.shared["decision_s"]
        self.charge = self.states["energy_j"] / self.states["capacity_j"]


@pytest.fixture(scope="module", params=ERRING)
def readings(request: pytest.FixtureRequest) -> Readings:
    return Readings(request.param, difficulty="harsh")


def top_power_w(robot: str = "rusti_computer") -> float:
    """Power at top speed, sensing fastest, on the flat, as a mission consumes it."""
    even = np.zeros(8)
    env = HomewardEnv(
        mission="Survey",
        robot=robot,
        difficulty="known",
        route=Route(300.0, even, even, even + 1.0, even),
    )
    env.reset(seed=0)
    env.step([4, 4, GO])
    env.step([4, 4, GO])
    return float(mission(env)["read_w"])


def test_gain_and_offset_belong_to_the_mission(readings: Readings) -> None:
    sizes, gain = readings.sizes, readings.start["meter_gain"]
    offset_w = readings.start["meter_offset_w"]
    most_w = sizes.power_offset * top_power_w()
    for values, centre, most in ((gain, 1.0, sizes.power_gain), (offset_w, 0.0, most_w)):
        if most == 0.0:
            assert (values == centre).all()
            continue
        assert (values.min(), values.max()) == pytest.approx(
            (centre - most, centre + most), abs=0.02 * most
        )
        assert values.mean() == pytest.approx(centre, abs=error(most / math.sqrt(3.0), MANY))
        assert values.std() == pytest.approx(most / math.sqrt(3.0), rel=0.05)
    for name in ("meter_gain", "meter_offset_w"):
        assert (readings.states[name] == readings.start[name]).all()


@pytest.mark.parametrize("robot", preset_names())
def test_an_offset_is_a_share_of_the_power_at_full_speed_and_rate(robot: str) -> None:
    sizes = Instruments(power_offset=0.1)
    shared = known_of(Options("Survey", robot=robot, difficulty="known", instruments=sizes)).shared[
        0
    ]
    assert shared["power_offset_w"] == pytest.approx(0.1 * top_power_w(robot), rel=0.02)


def test_power_is_read_with_gain_offset_and_noise(readings: Readings) -> None:
    s, sizes = readings.states, readings.sizes
    noise = (s["read_w"] - s["meter_offset_w"]) / readings.power_w - s["meter_gain"]
    check_noise(noise, sizes.power_noise, readings)


def test_speed_is_read_with_noise(readings: Readings) -> None:
    s, sizes = readings.states, readings.sizes
    moving = s["speed_mps"] > 0.0
    assert moving.mean() > 0.95
    noise = np.where(moving, s["read_mps"] / np.where(moving, s["speed_mps"], 1.0) - 1.0, 0.0)
    check_noise(noise, sizes.speed_noise, readings)


def check_noise(noise: NDArray[np.float64], deviation: float, readings: Readings) -> None:
    """Of mean 0, of its deviation, and another in every decision and mission, whatever the robot
    does."""
    assert noise.mean() == pytest.approx(0.0, abs=error(deviation, noise.size))
    assert noise.std() == pytest.approx(deviation, rel=0.02)
    for other in (
        noise[1:],
        readings.power_w[:-1],
        np.broadcast_to(readings.start["meter_gain"], noise[:-1].shape),
    ):
        correlation = np.corrcoef(noise[:-1].ravel(), other.ravel())[0, 1]
        assert correlation == pytest.approx(0.0, abs=error(1.0, noise[:-1].size))
    assert np.corrcoef(noise[:, 0], noise[:, 1])[0, 1] == pytest.approx(0.0, abs=0.6)


def test_the_grade_of_a_place_is_read_once_and_kept(readings: Readings) -> None:
    """As the pitch is averaged over the way through it: the way back reads the same."""
    deviation = readings.sizes.grade_noise
    name = next(name for name in ERRING if INSTRUMENTS[name] is readings.sizes)
    envs = HomewardVectorEnv(MANY, instruments=name)
    envs.reset(seed=0)
    places = envs.batch.routes["places"][:, : envs.batch.known.shared["places"][0]]
    noise = places["sine_read"].astype(float) - places["sin_grade"]
    assert noise.mean() == pytest.approx(0.0, abs=error(deviation, noise.size))
    assert noise.std() == pytest.approx(deviation, rel=0.02)
    assert (noise[:, 1:] * noise[:, :-1]).mean() / deviation**2 == pytest.approx(
        0.0, abs=error(1.0, noise.size)
    )
    before = places["sine_read"].copy()
    for mode in (GO, GO, RETURN):
        observations, *_ = envs.step(np.array([[4, 0, mode]] * MANY))
    np.testing.assert_array_equal(places["sine_read"], before)
    here = before[np.arange(MANY), envs.batch.records["place"]]
    np.testing.assert_allclose(observations[:, INDEX["grade"]], 10.0 * here, rtol=1e-6)


def test_the_steepest_slope_is_read_within_bounds() -> None:
    even = np.zeros(8)
    env = make("OutAndBack", route=Route(300.0, even + 0.8, even, even + 1.0, even), instruments=Instruments(
        grade_noise=0.5), difficulty="known")  # fmt: skip
    assert env.reset(seed=1)[0] in env.observation_space
    assert np.abs(env.batch.routes["places"]["sine_read"]).max() == pytest.approx(0.8)


def test_the_gauge_shows_whole_steps_between_empty_and_full(readings: Readings) -> None:
    soc, step = readings.states["soc"], readings.sizes.soc_step
    np.testing.assert_allclose(soc / step, np.rint(soc / step), atol=1e-9)
    assert soc.min() >= 0.0 and soc.max() <= 1.0
    assert len(np.unique(soc)) > 30


def test_the_steps_of_a_gauge_round_to_the_nearest() -> None:
    found = Readings(Instruments(soc_step=0.01), 200)
    off = found.states["soc"] - found.charge
    assert np.abs(off).max() <= 0.005 + 1e-9
    assert off.mean() == pytest.approx(0.0, abs=2e-4) and off.std() == pytest.approx(
        0.01 / math.sqrt(12.0), rel=0.03
    )


def test_the_noise_of_a_gauge_is_what_it_is_called() -> None:
    found = Readings(Instruments(soc_noise=0.003), 200)
    # a full battery cannot be read as more than full
    off = (found.states["soc"] - found.charge)[5:]
    assert off.std() == pytest.approx(0.003, rel=0.03) and off.mean() == pytest.approx(
        0.0, abs=error(0.003, off.size)
    )


@pytest.mark.parametrize("decision_s", [10.0, 60.0, 300.0])
def test_the_lag_of_a_gauge_is_a_time_whatever_the_length_of_a_decision(decision_s: float) -> None:
    """Behind an even discharge of rate r it shows r * lag * (1 - exp(-t / lag)) too much."""
    even, lag_s = np.zeros(8), 120.0
    route = Route(300.0, even, even, even + 1.0, even)
    env = make(
        "OutAndBack",
        route=route,
        decision_s=decision_s,
        difficulty="known",
        instruments=Instruments(soc_lag_s=lag_s),
    )
    env.reset(seed=0)
    for decision in range(1, 6):
        env.step([4, 0, GO])
        m, time_s = mission(env), decision * decision_s
        charge = float(m["energy_j"] / m["capacity_j"])
        behind = (1.0 - charge) / time_s * lag_s * (1.0 - math.exp(-time_s / lag_s))
        assert m["soc"] - charge == pytest.approx(behind, rel=1e-6)
        assert m["metered"] == pytest.approx(charge, abs=1e-9), (
            "the lag is known, and so does no harm"
        )


METERED = {"meter": (0.0006, 0.002, 0.0006), "gauge": (0.0045, 0.015, 0.005)}
"""Of the metered state of charge: root mean square error at any time, largest error, and largest
error of a change over one decision once 20 are over. A decision takes about 0.01."""


def test_the_metered_charge_is_near_the_truth_and_even(readings: Readings) -> None:
    """Nearer than the gauge is, from first to last, and without its steps."""
    name = next(name for name in ERRING if INSTRUMENTS[name] is readings.sizes)
    rms, most, uneven = METERED[name]
    off, gauge = (
        readings.states["metered"] - readings.charge,
        readings.states["soc"] - readings.charge,
    )
    assert np.sqrt((off**2).mean(axis=1)).max() < rms and np.abs(off).max() < most
    assert (off[20:] ** 2).mean() < 0.7 * (gauge[20:] ** 2).mean()
    assert np.abs(off[20:].mean(axis=1)).max() < 0.5 * rms, "neither too hopeful nor too careful"
    changes = np.diff(readings.states["metered"], axis=0) - np.diff(readings.charge, axis=0)
    assert np.abs(changes[20:]).max() < uneven
    assert (np.diff(readings.states["metered"], axis=0) < 1e-12).mean() > 0.99, (
        "it falls, as nothing comes back"
    )


@pytest.mark.parametrize(
    "sizes", [{"speed_noise": 0.01}, {"power_noise": 0.01}, {"power_gain": 0.02}]
)
@pytest.mark.parametrize("difficulty", ["known", "uncertain"])
def test_a_charge_is_metered_before_anything_is_used(
    sizes: dict[str, Any], difficulty: str
) -> None:
    """A gauge without errors leaves no doubt to weigh what is expected by; a mission over at once
    used nothing."""
    env = make("OutAndBack", instruments=Instruments(**sizes), difficulty=difficulty)
    env.reset(seed=0)
    observation, _, terminated, *_ = env.step([0, 0, RETURN])
    assert (
        terminated
        and feature(observation, "metered") == 1.0
        and observation in env.observation_space
    )
    env.reset(seed=0)
    env.step([4, 4, GO])
    observation, *_ = env.step([4, 4, GO])
    assert feature(observation, "metered") == pytest.approx(
        feature(observation, "energy"), abs=0.02
    )


@pytest.mark.parametrize("instruments", ERRING)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_a_copy_reads_the_same_under_the_same_commands(mission_id: str, instruments: str) -> None:
    env = make(mission_id, instruments=instruments, decision_s=60.0)
    env.reset(seed=3)
    for _ in range(5):
        env.step([3, 2, GO])
    other = copy.deepcopy(env)
    other.np_random.random(7)  # what is drawn elsewhere does not matter
    for action in [[4, 4, GO], [1, 0, GO], [0, 0, STOP], [2, 4, GO], [4, 1, RETURN]]:
        np.testing.assert_array_equal(env.step(action)[0], other.step(action)[0])
    np.testing.assert_array_equal(env.batch.records, other.batch.records)


@pytest.mark.parametrize("instruments", ERRING)
def test_a_mission_driven_otherwise_meets_the_same_noise(instruments: str) -> None:
    """At the same decision: noise follows from the key and the decision, not from what was done."""
    env = make("Survey", instruments=instruments, decision_s=60.0)
    env.reset(seed=3)
    noise = []
    for one, speed in ((copy.deepcopy(env), 4), (copy.deepcopy(env), 1)):
        found = []
        for decision in range(8):
            before_j = float(mission(one)["energy_j"])
            one.step([speed, (speed + decision) % 5, GO])
            m = mission(one)
            power_w = (before_j - m["energy_j"]) / 60.0
            found.append(
                (m["read_mps"] / m["speed_mps"], (m["read_w"] - m["meter_offset_w"]) / power_w)
            )
        noise.append(found)
    np.testing.assert_allclose(noise[0], noise[1], rtol=1e-9)
    assert len(np.unique(np.round(noise[0], 9))) == 16


def test_exact_instruments_read_the_truth() -> None:
    found = Readings("exact", 100, difficulty="harsh")
    s = found.states
    for name in ("soc", "metered"):
        np.testing.assert_array_equal(s[name], found.charge)
    np.testing.assert_allclose(s["read_w"], found.power_w, rtol=1e-12)
    np.testing.assert_array_equal(s["read_mps"], s["speed_mps"])
    used_j = found.start["energy_j"] - found.records["energy_j"]
    np.testing.assert_allclose(s["metered_j"][-1], used_j, rtol=1e-12)
    assert (
        load_instruments("exact") == Instruments()
        and known_of(Options("Survey")).instruments != Instruments()
    )


def toml(folder: Path, text: str | bytes) -> Path:
    path = folder / "instruments.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_file_of_the_same_sizes_reads_the_same(tmp_path: Path, name: str) -> None:
    sizes = dataclasses.asdict(INSTRUMENTS[name])
    path = toml(
        tmp_path, "".join(f"{field} = {json.dumps(value)}\n" for field, value in sizes.items())
    )
    envs = [
        make("Survey", instruments=given) for given in (name, path, str(path), INSTRUMENTS[name])
    ]
    firsts = [env.reset(seed=1)[0] for env in envs]
    for action in ([4, 2, GO], [2, 4, GO]):
        observations = [env.step(action)[0] for env in envs]
        assert (
            all((one == observations[0]).all() for one in observations)
            and (firsts[0] == firsts[1]).all()
        )
    assert load_instruments(path) == INSTRUMENTS[name]
    assert load_instruments(toml(tmp_path, "")) == Instruments()


BROKEN: dict[str | bytes, str] = {
    "soc_step = ": "Invalid value",
    "soc_step": "Expected '=' after a key",
    "soc_step = 0.1\nsoc_step = 0.2\n": "Cannot overwrite a value",
    b"\xff\xfe": "can't decode byte",
    "soc_steps = 0.1": "unknown size 'soc_steps'; allowed: soc_step, soc_noise, soc_lag_s, power_gain, power_offset,",
    "[gauge]\nsoc_step = 0.1": "unknown size 'gauge'; allowed: soc_step",
    "soc_step = 0.6": "soc_step = 0.6 is not allowed; give a number in [0, 0.5]",
    "power_noise = -0.1": "power_noise = -0.1 is not allowed; give a number in [0, 0.5]",
    "soc_lag_s = 4000": "soc_lag_s = 4000 is not allowed; give a number in [0, 3600]",
    "soc_noise = nan": "soc_noise = nan is not allowed",
    "soc_noise = inf": "soc_noise = inf is not allowed",
    "soc_noise = true": "soc_noise = True is not allowed",
    "soc_noise = 'much'": "soc_noise = 'much' is not allowed",
    "soc_noise = [0.1]": "soc_noise = [0.1] is not allowed",
}


@pytest.mark.parametrize(("text", "says"), BROKEN.items())
def test_a_file_that_cannot_be_used_says_why_in_one_line(
    tmp_path: Path, text: str | bytes, says: str
) -> None:
    path = toml(tmp_path, text)
    with pytest.raises(OptionError) as caught:
        HomewardEnv(instruments=path)
    assert (
        says in str(caught.value)
        and str(path) in str(caught.value)
        and "\n" not in str(caught.value)
    )


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("gage", "instruments = 'gage'; choose exact, meter, gauge, any_gauge or name a TOML file"),
        ("", "instruments = ''; choose exact, meter, gauge, any_gauge or name a TOML file"),
        ("meter.csv", "choose exact, meter, gauge"),
        (Path("meter"), "instruments = 'meter'; choose exact, meter, gauge"),
        (5, "instruments = 5; choose exact, meter, gauge"),
        (True, "instruments = True; choose"),
        (["meter"], "instruments = ['meter']; choose"),
        ({"soc_step": 0.1}, "instruments = {'soc_step': 0.1}; choose"),
        (b"meter", "instruments = b'meter'; choose"),
        ("no/such.toml", "no/such.toml"),
        ("a\0.toml", "null"),
    ],
)
def test_instruments_that_are_none_say_what_there_is(given: Any, says: str) -> None:
    with pytest.raises(OptionError) as caught:
        HomewardEnv(instruments=given)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "some.toml").mkdir()
    with pytest.raises(OptionError, match=r"some\.toml"):
        HomewardEnv(instruments=tmp_path / "some.toml")


@pytest.mark.parametrize(
    "field", [field.name for field in dataclasses.fields(Instruments) if field.name != "gauges"]
)
def test_sizes_have_bounds(field: str) -> None:
    most: Any = 3600.0 if field == "soc_lag_s" else 0.5
    assert getattr(Instruments(**{field: most}), field) == most
    wrong: list[Any] = [-1e-9, 1.001 * most, math.nan, math.inf, None, "1", True, 1j, [0.1]]
    for value in wrong:
        with pytest.raises(InstrumentError, match=f"^{field} = .*give a number in"):
            Instruments(**{field: value})


def test_the_worst_of_instruments_stay_within_the_observation_space() -> None:
    worst = Instruments(0.5, 0.5, 3600.0, 0.5, 0.5, 0.5, 0.5, 0.5)
    envs = HomewardVectorEnv(100, instruments=worst, difficulty="harsh")
    observations, _ = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(40):
        assert observations in envs.observation_space
        observations, rewards, *_ = envs.step(
            np.column_stack((rng.integers(0, 5, (100, 2)), np.full(100, GO)))
        )
        assert np.isfinite(rewards).all()


def test_a_gauge_shows_charge_and_agents_see_its_energy() -> None:
    """Of a lead-acid battery a quarter of the charge is less than a quarter of the energy."""
    robot = dataclasses.replace(load_robot("husky"), chemistry="lead_acid", cells_in_series=12)
    coarse = Instruments(soc_step=0.25)
    env = HomewardEnv(mission="OutAndBack", robot=robot, difficulty="known", instruments=coarse)
    env.reset(seed=0)
    shown, over = set(), False
    while not over:
        observation, _, terminated, truncated, _ = env.step([4, 0, 1])
        shown.add(round(float(observation[INDEX["energy"]]), 6))
        over = terminated or truncated
    steps = [float(energy_share(robot.curve, share)) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert shown <= {round(float(np.float32(step)), 6) for step in steps} and len(shown) == 5
