"""What means unknown is left out with a line and counted, alike in tables, bags and live input."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.logs.recordings import read_recording
from homeward.logs.unknown import VALUES, WORDS, unknown

Write = Callable[[pd.DataFrame], Path]


@pytest.mark.parametrize("word", [*sorted(WORDS), "--.-- ", "N/A"])
def test_a_word_is_a_missing_value(table: pd.DataFrame, csv: Write, word: str) -> None:
    table["power_w"] = table.power_w.astype(object)
    table.loc[:4, "power_w"] = word
    read = read_recording(csv(table))
    assert np.isnan(read.channels["power_w"]).sum() == 5
    # which takes them for empty cells
    by_pandas = word.lower().strip() in ("na", "nan", "null", "none", "n/a", "#n/a")
    assert (
        by_pandas
        or f"5 times power_w is '{word.strip()}', which means unknown: left out" in read.notes
    )


@pytest.mark.parametrize("channel", VALUES)
def test_a_value_is_a_missing_value(table: pd.DataFrame, csv: Write, channel: str) -> None:
    usual = {
        "soc": 0.5,
        "voltage_v": 24.0,
        "current_a": 3.0,
        "elevation_m": 400.0,
        "heading_rad": 1.0,
    }
    table[channel] = table.get(channel, usual.get(channel, 20.0))
    for value in VALUES[channel]:
        changed = table.copy()
        changed.loc[[7, 300], channel] = np.float32(value)
        read = read_recording(csv(changed))
        assert np.flatnonzero(np.isnan(read.channels[channel])).tolist() == [7, 300]
        assert [note for note in read.notes if note.startswith(f"2 of 600 values of {channel} are")]


PUBLISHED: dict[str, list[float]] = {
    "voltage_v": [(2**16 - 1) / 1000.0, 2**16 - 1, -1.0, -0.001],  # mV, V
    "current_a": [(2**16 - 1) / 100.0, (2**15 - 1) / 100.0, -(2**15) / 100.0, -0.01],  # cA
    "power_w": [2**16 - 1],
    "speed_mps": [(2**16 - 1) / 100.0, 2**16 - 1],  # cm/s, m/s
    "soc": [-0.01, -1.0, 2.55, 255.0],  # -1 %, -1, UINT8_MAX % and UINT8_MAX
    "heading_rad": [math.radians((2**16 - 1) / 100.0), math.radians(2**16 - 1)],  # cdeg, degrees
    "temperature_c": [(2**15 - 1) / 100.0, -(2**15) / 100.0, -273.15],  # cdegC, absolute zero
    "elevation_m": [-(2**15), 2**15 - 1, -9999.0, -999.0, -99999.0],
}
"""What MAVLink, MAVROS, SRTM and GeoTIFF write, by the type and the unit of their fields."""


def test_the_values_that_are_published_are_those_that_are_left_out() -> None:
    assert VALUES.keys() == PUBLISHED.keys()
    for channel, values in PUBLISHED.items():
        assert sorted(VALUES[channel]) == pytest.approx(sorted(values), rel=1e-7), channel


def test_zero_is_unknown_among_other_heights_only() -> None:
    assert unknown("elevation_m", np.array([410.0, 0.0, 412.0, 0.0, *[411.0] * 20])).sum() == 2
    assert not unknown("elevation_m", np.array([3.0, 1.0, 0.0, -1.0, *[4.0] * 20])).any()
    assert not unknown("elevation_m", np.zeros(9)).any()


def test_a_mapping_names_further_words_and_values(
    table: pd.DataFrame, csv: Write, tmp_path: Path
) -> None:
    table["power_w"] = table.power_w.astype(object)
    table.loc[3, "power_w"], table.loc[4, "power_w"] = "off", -7.0
    mapping = tmp_path / "map.toml"
    power = '{ column = "power_w", factor = 2.0, unknown = ["Off", -7] }'
    mapping.write_text(
        f'[columns]\ntime_s = "time_s"\nspeed_mps = "speed_mps"\npower_w = {power}\n'
    )
    read = read_recording(csv(table), mapping)
    assert np.flatnonzero(np.isnan(read.channels["power_w"])).tolist() == [3, 4]
    assert "1 times power_w is 'off', which means unknown: left out" in read.notes


def test_a_battery_that_knows_nothing_yet(tmp_path: Path) -> None:
    """As MAVROS publishes one: 65.535 V, 0.01 A and -0.01 until the autopilot reports; and one
    percentage of 2430."""
    pytest.importorskip("rosbags")
    pytest.importorskip("cyclonedds", reason="the live listener is of the extra ros2")
    from tests.logs.bag_writer import Stream, write_bag
    from tests.watch.online.test_listener import BATTERY, ODOMETRY, Bench, battery, drive

    time_s = np.arange(0.0, 60.0, 0.2)
    silent = np.isin(np.arange(300), [*range(10), 150])
    soc = np.where(np.arange(300) == 200, 24.3, np.where(silent, -0.01, 0.8))
    values = {
        "voltage": np.where(silent, 65.535, 24.0), "current": np.where(silent, 0.01, -4.0), "percentage": soc,
    }  # fmt: skip
    odometry = Stream(ODOMETRY, time_s, {"twist.twist.linear.x": 1.0})
    read = read_recording(
        write_bag(
            tmp_path, "mcap", {"/odom": odometry, "/battery": Stream(BATTERY, time_s, values)}
        )
    )
    for name, value in (("voltage_v", 24.0), ("current_a", 4.0), ("soc", 0.8)):
        known = read.channels[name][np.isfinite(read.channels[name])]
        assert len(known) > 280 and np.abs(known - value).max() < 1e-6
    assert "11 of 300 messages of /battery have an unknown voltage: left out" in read.notes
    bench = Bench({"/battery": BATTERY, "/odom": ODOMETRY})
    heard = bench.feed(30, odom=drive, battery=lambda t: battery(t, 65.535, 0.01, -0.01))
    assert heard is not None and "current_a" not in heard.reading and "soc" not in heard.reading
    heard = bench.feed(5, odom=drive, battery=lambda t: battery(t, 24.0, -4.0, 0.8))
    assert heard is not None and heard.reading["current_a"] == pytest.approx(4.0)
    assert math.isclose(heard.reading["soc"], 0.8)
