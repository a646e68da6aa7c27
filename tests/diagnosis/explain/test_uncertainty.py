"""What is known together only is said together, and the range is that of the trips that were
recorded."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Analysis, Recording, analyse, diagnose
from homeward.physics import replay
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]


def on_level_ground(drives: list[Recording], robot: Robot, cold: bool = False) -> list[Recording]:
    """The same motion of a robot on the level, with noise of 3 W, while a frosty day gets warmer if
    told so."""
    found = []
    for seed, one in enumerate(drives):
        of = {**one.channels, "grade_rad": np.zeros(len(one))}
        if cold:
            of["temperature_c"] = -15.0 + 5.0 * seed + 5.0 * np.linspace(0.0, 1.0, len(one))
        power_w = replay(
            robot, of["time_s"], of["speed_mps"], yaw_rate_radps=of["yaw_rate_radps"], sensing_hz=of["sensing_hz"],
            temperature_c=of.get("temperature_c", np.full(len(one), 20.0)),
        ).power_w  # fmt: skip
        of["power_w"] = power_w + 3.0 * np.random.default_rng(seed).standard_normal(len(one))
        found.append(Recording(one.name, one.sha256, of))
    return found


def test_of_a_mass_that_no_slope_shows_only_its_product_with_inertia_is_known(
    short_drive: Drive, husky: Robot
) -> None:
    true = dataclasses.replace(husky, effects={"inertia": {"mass_factor": 0.8}})
    heavier = dataclasses.replace(husky, mass_kg=1.2 * husky.mass_kg)
    analysis = analyse(on_level_ground(short_drive(husky), true), heavier)
    (product,) = analysis.diagnosis.products
    assert product.of == ("m / Gamma", "inertia mass_factor")
    assert product.value.value == pytest.approx(
        0.8 * husky.mass_kg / husky.traction_efficiency, rel=0.05
    )
    mass = (
        next(one for one in analysis.evidence.estimates if one.group.name == "mass")
        if analysis.evidence
        else None
    )
    assert mass is not None and mass.fitted is None and "m / Gamma" not in {
        one.group for one in analysis.diagnosis.parameters_off
    }  # fmt: skip


def test_of_a_mass_that_no_slope_shows_only_its_product_with_the_scrub_of_turning_is_known(
    short_drive: Drive, husky: Robot
) -> None:
    true = dataclasses.replace(husky, effects={"turning": {"scrub": 0.3}})
    heavier = dataclasses.replace(husky, mass_kg=1.2 * husky.mass_kg)
    turned = [  # at the tenths of rad/s that were meant: noise of the rate is no turning
        dataclasses.replace(
            run,
            channels={**run.channels, "yaw_rate_radps": run.channels["yaw_rate_radps"].round(1)},
        )
        for run in short_drive(husky)
    ]
    diagnosis = diagnose(on_level_ground(turned, true), heavier)
    (product,) = diagnosis.products
    assert product.of == ("m / Gamma", "turning scrub") and product.value.unit == "kg"
    low, high = ends(product.value)
    assert low <= 0.3 * husky.mass_kg / husky.traction_efficiency <= high
    assert high - low < 0.1 * product.value.value
    assert "m / Gamma" not in {one.group for one in diagnosis.parameters_off}


def test_of_computing_that_grows_with_the_rate_only_the_share_that_any_sensing_takes_is_known(
    short_drive: Drive, husky: Robot
) -> None:
    """What grows with the rate may as well be energy per sample: no part of it is called
    measured."""
    true = dataclasses.replace(husky, effects={"compute": {"power_w": 60.0, "base_share": 0.7}})
    analysis = analyse(short_drive(true), husky)
    (computing,) = analysis.diagnosis.missing_physics
    for name, value in true.effects["compute"].items():
        low, high = ends(computing.parameters[name])
        assert low <= value <= high and high - low > 0.2 * value
    known = {one.of: one.value for one in analysis.diagnosis.products}
    any_sensing = known["compute base_share", "compute power_w"]
    assert ends(any_sensing)[0] <= 42.0 <= ends(any_sensing)[1]
    assert "P_anc, per sample" not in {one.group for one in analysis.diagnosis.parameters}
    assert {"P_anc, idle part", "C_rr m / Gamma"} <= {
        one.group for one in analysis.diagnosis.parameters
    }


def test_of_a_battery_that_was_always_cold_no_parameter_is_known_without_it(
    short_drive: Drive, husky: Robot
) -> None:
    """A robot that draws more of everything, or a battery that holds less at any temperature that
    was met."""
    true = dataclasses.replace(husky, effects={"cold_battery": {"per_k": 0.008, "warm_c": 30.0}})
    diagnosis = diagnose(on_level_ground(short_drive(husky), true, cold=True), husky)
    (cold,) = diagnosis.missing_physics
    assert cold.effect == "cold_battery"
    low, high = ends(cold.parameters["warm_c"])
    assert low <= 30.0 <= high and high > 10.0  # warmer than it ever was
    low, high = ends(cold.parameters["per_k"])
    assert low <= 0.008 <= high
    assert not {"C_rr m / Gamma", "P_anc, idle part"} & {one.group for one in diagnosis.parameters}
    assert any(one.of == ("C_rr m / Gamma", "cold_battery per_k") for one in diagnosis.products)


@pytest.mark.parametrize(
    ("effect", "numbers"),
    [
        ("heater", {"w_per_k": 20.0, "on_below_c": 6.0}),
        ("cooler", {"w_per_k": 20.0, "on_above_c": -16.0}),
    ],
)
def test_of_what_is_always_on_neither_set_point_nor_idle_power_is_known(
    short_drive: Drive, husky: Robot, effect: str, numbers: dict[str, float]
) -> None:
    """A set point a kelvin further and another idle power are the same load: only their sum is
    known."""
    true = dataclasses.replace(husky, effects={effect: numbers})
    diagnosis = diagnose(on_level_ground(short_drive(husky), true, cold=True), husky)
    (missing,) = diagnosis.missing_physics
    assert missing.effect == effect
    for name, value in numbers.items():
        low, high = ends(missing.parameters[name])
        assert low <= value <= high, name
    assert "P_anc, idle part" not in {parameter.group for parameter in diagnosis.parameters}
    assert ("P_anc, idle part", effect) in {product.of for product in diagnosis.products}


def test_the_range_is_that_of_the_recorded_trips(
    scrubbing: Analysis, short_drive: Drive, husky: Robot
) -> None:
    """Turning costs range on trips with turns, while d_max on the level hardly knows of it."""
    recordings, analysis = short_drive(husky, effects={"turning": {"scrub": 0.3}}), scrubbing
    found = analysis.diagnosis.range
    assert found is not None
    # by corrected.toml
    said_j = sum(float(np.sum(analysis.per_sample(one.name)) * 0.1) for one in recordings)
    drawn_j = sum(float(np.sum(one.channels["power_w"]) * 0.1) for one in recordings)
    driven_m = sum(float(np.sum(one.channels["speed_mps"]) * 0.1) for one in recordings)
    assert found.recorded_m == pytest.approx(husky.usable_energy_j * driven_m / drawn_j, rel=0.01)
    assert (
        found.file_m == pytest.approx(found.recorded_m, rel=0.01)
        and found.nominal_m > 1.1 * found.file_m
    )
    assert found.ci95[0] < found.recorded_m < found.ci95[1]
    assert found.file_m == pytest.approx(
        analysis.corrected.usable_energy_j * driven_m / said_j, rel=0.01
    )
    with pytest.raises(KeyError):
        analysis.per_sample("unknown.csv")
