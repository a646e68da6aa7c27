"""The schema: limits of what is possible, likely mistaken units, and sets of channels."""

import math

import numpy as np
import pandas as pd
import pytest

from homeward.diagnosis import read_recording
from homeward.logs.channels import CHANNELS, MOTION, POWER, Channel, first_set, lacking
from tests.logs.refused import Write, refusal


def test_limits_are_included_and_what_lies_beyond_is_impossible() -> None:
    speed = CHANNELS["speed_mps"]
    values = np.array([-70.1, -70.0, 0.0, 70.0, 70.1, np.inf, np.nan])
    assert speed.impossible(values).tolist() == [True, False, False, False, True, True, False]


@pytest.mark.parametrize(
    ("channel", "unit", "value", "si"),
    [
        ("speed_mps", "km/h", 36.0, 10.0),
        ("yaw_rate_radps", "degrees per second", 180.0, math.pi),
        ("grade_rad", "degrees", 45.0, math.pi / 4.0),
        ("grade_rad", "per cent", 12.0, 0.12),
        ("time_s", "nanoseconds", 5e8, 0.5),
        ("soc", "per cent", 95.0, 0.95),
        ("current_a", "milliamperes", 2500.0, 2.5),
        ("payload_kg", "grams", 750.0, 0.75),
    ],
)
def test_a_mistaken_unit_has_its_factor_to_si(
    channel: str, unit: str, value: float, si: float
) -> None:
    assert dict(CHANNELS[channel].mistaken)[unit] * value == pytest.approx(si)


@pytest.mark.parametrize("channel", CHANNELS.values(), ids=CHANNELS)
def test_a_channel_has_its_unit_in_its_name_and_room_for_real_values(channel: Channel) -> None:
    ending = {"1": "soc", "degC": "_c", "1/s": "_hz", "m/s": "_mps", "rad/s": "_radps"}.get(
        channel.unit, f"_{channel.unit.lower()}"
    )
    assert channel.name.endswith(ending)
    assert channel.low < channel.high and not channel.impossible(np.array([0.0, 0.5]))[0]
    # SI is the largest unit of each
    assert all(0.0 < factor < 1.0 for _, factor in channel.mistaken)


def test_the_most_informative_complete_set_is_taken() -> None:
    assert first_set(POWER, ["current_a", "motor_left_a", "motor_right_a"]) == (
        "motor_left_a",
        "motor_right_a",
    )
    assert first_set(POWER, {"motor_left_a", "motor_right_a", "voltage_v", "current_a"}) == (
        "voltage_v",
        "current_a",
    )
    assert first_set(POWER, ["voltage_v", "motor_left_a"]) == () == first_set(MOTION, [])


def test_what_lacks_is_said_with_all_that_would_do() -> None:
    assert lacking(["speed_mps", "power_w"]) is None
    assert lacking(["power_w"]) == "motion channel (speed_mps or wheel_left_mps + wheel_right_mps)"
    assert lacking(["wheel_left_mps", "wheel_right_mps", "voltage_v"]) == (
        "power channel (power_w or voltage_v + current_a or motor_left_a + motor_right_a)"
    )


@pytest.mark.parametrize(
    ("channel", "values", "unit"),
    [
        ("speed_mps", (0.0, 900.0), "mm/s"),
        ("speed_mps", (0.0, 130.0), "km/h"),
        ("grade_rad", (-12.0, 12.0), "degrees"),
        ("yaw_rate_radps", (-90.0, 90.0), "degrees per second"),
        ("heading_rad", (0.0, 359.0), "degrees"),
        ("soc", (20.0, 95.0), "per cent"),
        ("temperature_c", (270.0, 300.0), "kelvin"),
        ("power_w", (1e6, 4e6), "milliwatts"),
        ("voltage_v", (2.2e4, 2.5e4), "millivolts"),
        ("current_a", (2e3, 9e3), "milliamperes"),
        ("motor_left_a", (2e3, 9e3), "milliamperes"),
    ],
)
def test_values_in_another_unit(
    table: pd.DataFrame, csv: Write, channel: str, values: tuple[float, float], unit: str
) -> None:
    table[channel] = np.tile([values[0], values[1], sum(values) / 2], 200)
    message = refusal(csv(table))
    assert channel in message and f"looks like {unit}" in message


def test_stray_values_are_left_out_and_noted(table: pd.DataFrame, csv: Write) -> None:
    table.loc[7, "speed_mps"] = 1e4
    recording = read_recording(csv(table))
    assert np.isnan(recording.channels["speed_mps"][7])
    assert recording.notes == (
        "1 of 600 values of speed_mps are outside -70 to 70 m/s and left out",
    )


def test_one_wrong_reading_in_sixty_is_no_other_unit(table: pd.DataFrame, csv: Write) -> None:
    table.loc[::60, "speed_mps"] = 900.0
    recording = read_recording(csv(table))
    assert np.isnan(recording.channels["speed_mps"]).sum() == 10
    assert "10 of 600 values of speed_mps are outside -70 to 70 m/s and left out" in recording.notes


@pytest.mark.parametrize("ratio", [0.7, 1.5])
def test_two_odometers_that_differ_are_asked_about(
    table: pd.DataFrame, csv: Write, ratio: float
) -> None:
    table["distance_m"] = np.cumsum(table.speed_mps) / 10.0 / ratio
    assert "which is right? Give the other a factor" in refusal(csv(table))
