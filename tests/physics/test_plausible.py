"""Values that are allowed but that no known ground robot has."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import pytest

from homeward import load_robot
from homeward.physics import preset_names
from homeward.physics.battery import FLAT
from homeward.physics.plausible import PlausibilityWarning, implausible
from homeward.physics.thresholds import PLAUSIBLE

HUSKY = dataclasses.replace(load_robot("husky"), chemistry=FLAT, cells_in_series=0)
"""Of any nominal voltage, as no cells contradict it."""


@pytest.mark.parametrize("preset", preset_names())
def test_presets_are_plausible(preset: str) -> None:
    assert implausible(load_robot(preset)) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mass_kg": 50_000.0}, "mass_kg = 50000"),
        ({"rated_energy_j": 480.0}, "rated_energy_j = 480"),  # watt hours
        ({"rolling_resistance": 0.9}, "rolling_resistance = 0.9"),
        ({"nominal_voltage_v": 24_000.0}, "nominal_voltage_v = 24000"),
        ({"controller_w": 50_000.0}, "W is known"),
        ({"mass_kg": 9000.0}, "rated_energy_j / mass_kg = 192 J/kg"),
    ],
)
def test_implausible_values_warn(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dataclasses.replace(HUSKY, **changes).to_toml())
    with pytest.warns(
        PlausibilityWarning, match=f"robot.toml: .*{re.escape(said)}.*is the unit right"
    ) as caught:
        load_robot(path)
    assert caught[0].filename == __file__


@pytest.mark.parametrize("name", [name for name, (low, _, _) in PLAUSIBLE.items() if low > 0.0])
def test_each_end_of_a_range_is_known_and_what_lies_beyond_is_named(name: str) -> None:
    low, high, unit = PLAUSIBLE[name]
    for value, plausible in ((low, True), (0.99 * low, False), (high, True), (1.01 * high, False)):
        change: Any = {name: value}
        robot = dataclasses.replace(HUSKY, min_speed_mps=1e-3, **change)
        said = [text for text in implausible(robot) if text.startswith(f"{name} = ")]
        assert (said == []) == plausible
        assert plausible or said == [
            f"{name} = {value:g}, where {low:g} to {high:g}{unit and ' ' + unit} is known"
        ]


def test_a_battery_that_weighs_more_or_holds_more_than_any_is_named_by_its_ratio() -> None:
    husky = load_robot("husky")
    assert implausible(dataclasses.replace(husky, rated_energy_j=50.0 * 249.0)) == [
        "rated_energy_j / mass_kg = 249 J/kg, where 250 to 3e+06 is known"
    ]
    assert implausible(dataclasses.replace(husky, rated_energy_j=50.0 * 3.1e6)) == [
        "rated_energy_j / mass_kg = 3.1e+06 J/kg, where 250 to 3e+06 is known"
    ]


def test_ancillary_powers_count_together() -> None:
    husky = load_robot("husky")
    parts: dict[str, Any] = {
        name: 5000.0 for name in ("sensing_idle_w", "communication_w", "controller_w", "computer_w")
    }
    assert implausible(dataclasses.replace(husky, **parts)) == []
    (said,) = implausible(dataclasses.replace(husky, **parts | {"computer_w": 5001.0}))
    assert said.endswith("computer_w = 20001 W, where at most 20000 W is known")
