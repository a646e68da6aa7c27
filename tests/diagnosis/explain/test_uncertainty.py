"""What is known together only is said together, and the range is that of the trips that were recorded."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording, analyse, diagnose
from homeward.diagnosis.explain.uncertainty import spread
from homeward.physics import replay

Drive = Callable[..., list[Recording]]


def on_level_ground(drives: list[Recording], robot: Robot) -> list[Recording]:
    """The same motion of a robot on the level, with noise of 3 W."""
    found = []
    for seed, one in enumerate(drives):
        of = {**one.channels, "grade_rad": np.zeros(len(one))}
        power_w = replay(
            robot, of["time_s"], of["speed_mps"], yaw_rate_radps=of["yaw_rate_radps"], sensing_hz=of["sensing_hz"]
        ).power_w
        of["power_w"] = power_w + 3.0 * np.random.default_rng(seed).standard_normal(len(one))
        found.append(Recording(one.name, one.sha256, of))
    return found


def test_of_a_mass_that_no_slope_shows_only_its_product_with_inertia_is_known(drive: Drive, husky: Robot) -> None:
    true = dataclasses.replace(husky, effects={"inertia": {"mass_factor": 0.8}})
    heavier = dataclasses.replace(husky, mass_kg=1.2 * husky.mass_kg)
    analysis = analyse(on_level_ground(drive(husky), true), heavier)
    (product,) = analysis.diagnosis.products
    assert product.of == ("m / Gamma", "inertia mass_factor")
    assert product.value.value == pytest.approx(0.8 * husky.mass_kg / husky.traction_efficiency, rel=0.05)
    mass = next(one for one in analysis.evidence.estimates if one.group.name == "mass") if analysis.evidence else None
    assert mass is not None and mass.fitted is None and "m / Gamma" not in {
        one.group for one in analysis.diagnosis.parameters_off
    }  # fmt: skip


def test_of_a_mass_that_no_slope_shows_only_its_product_with_the_scrub_of_turning_is_known(
    short_drive: Drive, husky: Robot
) -> None:
    true = dataclasses.replace(husky, effects={"turning": {"scrub": 0.3}})
    heavier = dataclasses.replace(husky, mass_kg=1.2 * husky.mass_kg)
    turned = [  # at the tenths of rad/s that were meant: noise of the rate is no turning
        dataclasses.replace(run, channels={**run.channels, "yaw_rate_radps": run.channels["yaw_rate_radps"].round(1)})
        for run in short_drive(husky)
    ]
    diagnosis = diagnose(on_level_ground(turned, true), heavier)
    (product,) = diagnosis.products
    assert product.of == ("m / Gamma", "turning scrub") and product.value.unit == "kg"
    low, high = product.value.ci95
    assert low <= 0.3 * husky.mass_kg / husky.traction_efficiency <= high
    assert high - low < 0.1 * product.value.value
    assert "m / Gamma" not in {one.group for one in diagnosis.parameters_off}


def test_the_range_is_that_of_the_recorded_trips(drive: Drive, husky: Robot) -> None:
    """Turning costs range on trips with turns, while d_max on the level hardly knows of it."""
    recordings = drive(husky, effects={"turning": {"scrub": 0.3}})
    analysis = analyse(recordings, husky)
    found = analysis.diagnosis.range
    assert found is not None
    said_j = sum(float(np.sum(analysis.per_sample(one.name)) * 0.1) for one in recordings)  # by corrected.toml
    drawn_j = sum(float(np.sum(one.channels["power_w"]) * 0.1) for one in recordings)
    driven_m = sum(float(np.sum(one.channels["speed_mps"]) * 0.1) for one in recordings)
    assert found.recorded_m == pytest.approx(husky.usable_energy_j * driven_m / drawn_j, rel=0.01)
    assert found.file_m == pytest.approx(found.recorded_m, rel=0.01) and found.nominal_m > 1.1 * found.file_m
    assert found.ci95[0] < found.recorded_m < found.ci95[1]
    assert found.file_m == pytest.approx(analysis.corrected.usable_energy_j * driven_m / said_j, rel=0.01)
    with pytest.raises(KeyError):
        analysis.per_sample("unknown.csv")


def test_spread_between_runs_is_told_from_noise_within_them() -> None:
    rng = np.random.default_rng(0)
    run = np.repeat(np.arange(40), 200)
    runs = dataclasses.make_dataclass("Some", ["run", "duration_s"])(run, np.full(8000, 0.5))
    noise = rng.standard_normal(8000)
    differ = 2.0 * rng.standard_normal(40)[run]
    assert spread(noise, runs, 1.0).deviation == pytest.approx(0.0, abs=0.05)
    assert spread(noise + differ, runs, 1.0).deviation == pytest.approx(2.0, rel=0.3)
    assert spread(noise + differ, runs, 1.0).rest == pytest.approx(1.0, rel=0.05)
