"""Several batteries: bags, logs of autopilots and a live network make the same choice, and say
it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs the extra logs")

from homeward.diagnosis import RecordingError, read_recording
from homeward.logs.bags.topics import load_topics
from tests.logs.bag_writer import Stream, write_bag
from tests.logs.flight_writer import write_dataflash
from tests.watch.online.test_listener import BATTERY, ODOMETRY, Bench, battery, drive

TIME_S = np.arange(0.0, 20.0, 0.2)
DRAWN_A = 4.0 + np.sin(TIME_S)
Packs = dict[str, tuple[float, float]]
CASES: dict[str, tuple[Packs, float | None, str]] = {
    # voltage and share of the current by the name of the topic, share that is right or None, what
    # is said
    "the sum and its parts": (
        {"battery_1": (24.0, 0.6), "battery_2": (24.0, 0.4), "battery": (24.0, 1.0)}, 1.0, "/battery is the sum",
    ),
    "packs in parallel": ({"battery_left": (24.0, 0.6), "battery_right": (24.1, 0.4)}, 1.0, "packs in parallel"),
    "the same one twice": ({"battery": (24.0, 1.0), "power/state": (24.0, 1.0)}, 1.0, "readings are equal"),
    "one that is not connected": ({"battery": (24.0, 1.0), "spare": (24.0, 0.0)}, 1.0, ""),
    "two of which nobody knows": ({"battery": (24.0, 1.0), "payload": (12.0, 0.3)}, None, "not which is the whole"),
    "a number, and another voltage": ({"battery_1": (24.0, 1.0), "battery_2": (12.0, 0.3)}, None, "has several"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_bag_and_a_network_choose_the_same(tmp_path: Path, case: str) -> None:
    packs, share, said = CASES[case]
    streams = {"/odom": Stream(ODOMETRY, TIME_S, {"twist.twist.linear.x": 1.0})}
    for name, (voltage_v, part) in packs.items():
        streams[f"/{name}"] = Stream(
            BATTERY, TIME_S, {"voltage": voltage_v, "current": -part * DRAWN_A}
        )
    bag = write_bag(tmp_path, "mcap", streams)
    bench = Bench({f"/{name}": BATTERY for name in packs} | {"/odom": ODOMETRY})

    def live() -> Any:
        made = {
            name: lambda t, of=of: battery(t, of[0], -4.0 * of[1]) for name, of in packs.items()
        }
        return bench.feed(30, odom=drive, **made)

    if share is None:
        for read in (lambda: read_recording(bag), live):
            with pytest.raises(RecordingError, match=said):
                read()
        return
    recording = read_recording(bag)
    np.testing.assert_allclose(recording.channels["current_a"], share * DRAWN_A, rtol=1e-3)
    assert said in " ".join(recording.notes)
    assert live().reading["current_a"] == pytest.approx(share * 4.0)
    assert said in " ".join(bench.listener.warnings(2.9))


def test_a_robot_on_its_way_keeps_its_battery_when_another_begins_to_draw() -> None:
    """It is asked about, with the remedy, and advice goes on."""
    bench = Bench({"/battery": BATTERY, "/payload": BATTERY, "/odom": ODOMETRY})

    def payload(time_s: float) -> Any:
        return battery(time_s, 12.0, -2.0 if time_s > 5.0 else 0.0)

    heard = bench.feed(80, odom=drive, battery=lambda t: battery(t, 24.0, -4.0), payload=payload)
    assert heard is not None
    assert (heard.reading["voltage_v"], heard.reading["current_a"]) == (24.0, 4.0)
    (said,) = bench.listener.warnings(7.9)
    assert "not which is the whole" in said and "/battery, which drew alone before, is used" in said


def test_a_mapping_says_which(tmp_path: Path) -> None:
    packs, *_ = CASES["two of which nobody knows"]
    streams = {"/odom": Stream(ODOMETRY, TIME_S, {"twist.twist.linear.x": 1.0})}
    for name, (voltage_v, part) in packs.items():
        streams[f"/{name}"] = Stream(
            BATTERY, TIME_S, {"voltage": voltage_v, "current": -part * DRAWN_A}
        )
    bag = write_bag(tmp_path, "mcap", streams)
    battery_fields = 'voltage_v = "voltage"\ncurrent_a = { field = "current", factor = -1.0 }\n'
    motion = '[[topics]]\nname = "/odom"\nspeed_mps = "twist.twist.linear.x"\n'
    for name, more, share in (
        ("/payload", "", 0.3),
        ("*", 'several = "sum"\n', 1.3),
        ("*", 'several = "first"\n', 1.0),
    ):
        entry = f'[[topics]]\nname = "{name}"\ntype = "{BATTERY}"\n'
        (tmp_path / "map.toml").write_text(motion + entry + battery_fields + more)
        read = read_recording(bag, tmp_path / "map.toml")
        np.testing.assert_allclose(read.channels["current_a"], share * DRAWN_A, rtol=1e-3)


def test_batteries_of_one_topic_and_instances_of_an_autopilot(tmp_path: Path) -> None:
    """Messages name the battery by location, serial number or frame; an autopilot numbers it."""
    odometry = Stream(ODOMETRY, TIME_S, {"twist.twist.linear.x": 1.0})
    slots = np.array(["slot 1", "slot 2"] * 50)
    values = {
        "voltage": 24.0,
        "current": -np.where(slots == "slot 1", 0.6, 0.4) * 4.0,
        "location": slots,
    }
    bag = write_bag(
        tmp_path, "mcap", {"/odom": odometry, "/battery": Stream(BATTERY, TIME_S, values)}
    )
    one_topic = read_recording(bag)
    np.testing.assert_allclose(one_topic.channels["current_a"], 4.0, rtol=1e-3)
    messages = [("THR", TIME_S, {"Speed": 1.0})]
    messages += [
        ("BAT", TIME_S, {"Inst": i, "Volt": 24.0, "Curr": part * 4.0})
        for i, part in enumerate((0.6, 0.4))
    ]
    flight = read_recording(write_dataflash(tmp_path / "run.bin", messages))
    np.testing.assert_allclose(flight.channels["current_a"], 4.0, rtol=1e-3)
    for recording, name in (
        (one_topic, "/battery@slot 2 (1.6 at 24 V)"),
        (flight, "BAT@1 (1.6 at 24 V)"),
    ):
        assert name in " ".join(recording.notes)


def test_a_list_of_batteries_in_one_message_is_chosen_from_alike(tmp_path: Path) -> None:
    kind, definition = (
        "my_msgs/msg/Packs",
        "std_msgs/Header header\nfloat32[] volts\nfloat32[] amps\n",
    )
    (tmp_path / "map.toml").write_text(
        f'[[topics]]\nname = "/packs"\ntype = "{kind}"\nvoltage_v = "volts[*]"\ncurrent_a = "amps[*]"\n'
        '[[topics]]\nname = "/odom"\nspeed_mps = "twist.twist.linear.x"\n'
    )
    amps = np.empty(len(TIME_S), dtype=object)
    amps[:] = [np.array([0.6 * drawn, 0.4 * drawn], np.float32) for drawn in DRAWN_A]
    streams = {
        "/odom": Stream(ODOMETRY, TIME_S, {"twist.twist.linear.x": 1.0}),
        "/packs": Stream(
            kind, TIME_S, {"volts": np.array([24.0, 24.1], np.float32), "amps": amps}, definition
        ),
    }
    recording = read_recording(write_bag(tmp_path, "mcap", streams), tmp_path / "map.toml")
    np.testing.assert_allclose(recording.channels["current_a"], DRAWN_A, rtol=1e-3)
    assert "/packs@0 (2.41 at 24 V), /packs@1" in " ".join(recording.notes)
    bench = Bench({"/packs": kind, "/odom": ODOMETRY}, load_topics(tmp_path / "map.toml"))
    heard: Any = bench.feed(
        30, odom=drive, packs=lambda t: SimpleNamespace(volts=[24.0, 24.1], amps=[2.4, 1.6])
    )
    assert heard.reading["current_a"] == pytest.approx(4.0)
    assert "packs in parallel" in " ".join(bench.listener.warnings(2.9))
