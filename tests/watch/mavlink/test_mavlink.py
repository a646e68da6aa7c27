"""`homeward watch --mavlink`: a second process plays a rover's log, which the test writes, over the
loopback."""

from __future__ import annotations

import json
import math
import re
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="needs the extra logs")
pytest.importorskip("rosbags", reason="needs the extra logs")

from pymavlink import mavutil

from homeward.cli import Terminal
from homeward.commands.watch import Args, main
from homeward.companion import Advice, Companion, CompanionError
from homeward.logs.bags.topics import load_topics
from homeward.physics import load_robot
from homeward.watch.mavlink import vehicle as vehicle_module
from homeward.watch.mavlink.telling import LONGEST_NAME, numbers
from homeward.watch.mavlink.translate import KINDS, Translator
from homeward.watch.mavlink.vehicle import Vehicle
from homeward.watch.online import listener as listener_module
from homeward.watch.online.link import News
from homeward.watch.online.listener import Listener
from homeward.watch.online.session import Session
from homeward.watch.online.texts import Severity

MAV: Any = mavutil.mavlink
LAT_DEG, LON_DEG = 47.0, 8.0
METRE_DEG = 1.0 / 111_195.0  # of latitude, on a sphere of EARTH_RADIUS_M
UNKNOWN_MV, NO_CELL = 65535, [65535] * 9
CELLS_MV = 6 * [4000]
SOC = 0.05


def battery(cells_mv: list[int], current_ca: int, remaining: int, number: int = 0) -> Any:
    cells = (cells_mv + 10 * [UNKNOWN_MV])[:10]
    return MAV.MAVLink_battery_status_message(
        number, 1, 1, 32767, cells, current_ca, -1, -1, remaining
    )


def attitude(time_ms: int, yaw_deg: float, pitch_deg: float = 0.0) -> Any:
    yaw_rad, pitch_rad = math.radians(yaw_deg), math.radians(pitch_deg)
    return MAV.MAVLink_attitude_message(time_ms, 0.0, pitch_rad, yaw_rad, 0.0, 0.0, 0.0)


def position(time_ms: int, east_m: float, speed_east_mps: float = 1.0) -> Any:
    lon_deg = LON_DEG + east_m * METRE_DEG / math.cos(math.radians(LAT_DEG))
    return MAV.MAVLink_global_position_int_message(
        time_ms,
        round(LAT_DEG * 1e7),
        round(lon_deg * 1e7),
        400_000,
        0,
        0,
        round(100 * speed_east_mps),
        0,
        65535,
    )


def home(lat_deg: float = LAT_DEG) -> Any:
    four, three = [1.0, 0.0, 0.0, 0.0], [0.0] * 3
    return MAV.MAVLink_home_position_message(
        round(lat_deg * 1e7), round(LON_DEG * 1e7), 0, 0, 0, 0, four, *three
    )


def heartbeat() -> Any:
    return MAV.MAVLink_heartbeat_message(
        MAV.MAV_TYPE_GROUND_ROVER, MAV.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3
    )


def rover_log(path: Path) -> Path:
    """A log of a rover that drives east from 500 m east of home, with a nearly empty battery that
    it knows late."""
    with path.open("wb") as log:
        writers = {number: MAV.MAVLink(None, srcSystem=number, srcComponent=1) for number in (3, 7)}
        for tick in range(400):
            time_ms = 41_250 + 100 * tick
            messages = [
                (3, attitude(time_ms, 90.0, 1.0)),
                (3, position(time_ms, 500.0 + 0.1 * tick)),
            ]
            if tick % 10 == 0:
                messages += [
                    (3, heartbeat()),
                    (3, home()),
                    (7, heartbeat()),
                    (7, position(time_ms, 9e4)),
                ]
                messages += [(3, MAV.MAVLink_wind_message(270.0, 3.0, 0.0))]
            knows = tick >= 40
            messages += [(3, battery(CELLS_MV, 500, 5) if knows else battery(NO_CELL, -1, -1))]
            messages += [
                (3, MAV.MAVLink_sys_status_message(0, 0, 0, 0, 12_000, 100, 99, 0, 0, 0, 0, 0, 0))
            ]
            for number, message in messages:
                log.write(
                    struct.pack(">Q", int(1.7e15) + 1000 * time_ms) + message.pack(writers[number])
                )
    return path


@pytest.fixture(scope="module")
def advice() -> Advice:
    """Of a robot with a full battery, 100 m from home."""
    companion = Companion("husky")
    companion.update(0.0, position=100.0)
    return companion.update(1.0, position=100.0)


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        number: int = free.getsockname()[1]
    return number


@pytest.fixture
def heard(tmp_path: Path, port: int) -> Iterator[Path]:
    """What the autopilot hears, while the log is played."""
    log, path = rover_log(tmp_path / "rover.tlog"), tmp_path / "heard.jsonl"
    command = [
        sys.executable,
        str(Path(__file__).with_name("player.py")),
        str(log),
        str(port),
        str(path),
    ]
    with subprocess.Popen(command) as player:
        try:
            yield path
        finally:
            player.kill()


@pytest.mark.usefixtures("advice")  # which compiles: the log does not wait for it
def test_a_rover_is_advised_and_told(
    heard: Path, port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(vehicle_module, "_SETTLES_S", 0.4)
    monkeypatch.setattr(listener_module, "_SETTLES_S", 0.4)
    vehicle = Vehicle(f"udpin:127.0.0.1:{port}")
    met = vehicle.meet(lambda text: None)
    assert met.home == (0.0, 0.0) and met.wind_mps == pytest.approx((-3.0, 0.0), abs=1e-6)
    assert met.said() == [
        "home is the autopilot's", "the forecast is the wind received: 3.0 m/s from 270 degrees",
    ]  # fmt: skip
    session = Session(
        load_robot("husky"), vehicle, "rover", "any_robot", met.home, forecast_mps=met.wind_mps
    )
    node, end_s = session.node, time.monotonic() + 60.0
    lines: list[dict[str, Any]] = []

    def done() -> bool:
        assert time.monotonic() < end_s, (node.advice, node.warnings, lines)
        lines[:] = [
            json.loads(line) for line in heard.read_text().splitlines() if line.endswith("}")
        ]
        names = {line["mavpackettype"] for line in lines}
        # The order is heard some time after it is given.
        told = "NAMED_VALUE_FLOAT" in names and any(
            is_order(line.get("text", "")) for line in lines
        )
        return told and "soc" in node.listener.sources and lacks(node.advice)

    session.run(Terminal(), quiet=False, done=done)
    vehicle.close()
    advice = node.advice
    # the other vehicle is 90 km away
    assert advice is not None and 500.0 < advice.way_home_m < 545.0
    assert advice.energy_left_j.mean < 3.0 * SOC * node.companion.robot.usable_energy_j
    assert node.listener.sources["voltage_v"] == node.listener.sources["soc"] == "BATTERY_STATUS"
    assert not any("impossible" in text for text in node.warnings), node.warnings
    assert "vehicle 7 is on the link too and left out: 3 is advised" in node.warnings
    assert {line["system"] for line in lines} == {3}
    texts = {
        line["text"]: line["severity"] for line in lines if line["mavpackettype"] == "STATUSTEXT"
    }
    (order,) = filter(is_order, texts)
    assert texts[order] in (Severity.ALERT, Severity.CRITICAL) and re.search(r"5\d\d m$", order)
    asked = next(line for line in lines if line["mavpackettype"] == "COMMAND_LONG")
    assert (asked["command"], asked["param1"]) == (MAV.MAV_CMD_REQUEST_MESSAGE, 242)
    assert "BATTERY_STATUS" in capsys.readouterr().out


def is_order(text: str) -> bool:
    return "may not get home" in text or "TURN NOW" in text


def lacks(advice: Advice | None) -> bool:
    return advice is not None and advice.turn_now


class Heard:
    """A listener that is fed with messages of MAVLink."""

    def __init__(self) -> None:
        self.translator, self.time_s = Translator(), 0.0
        self.listener = Listener(load_topics("any_robot"), 1.0)
        self.listener.offer(KINDS)

    def feed(self, *messages: Any) -> dict[str, Any]:
        """Messages ten times a second for 3 s; what was read at last."""
        reading: dict[str, Any] = {}
        for _ in range(30):
            for message in messages:
                if hasattr(message, "time_boot_ms"):
                    message.time_boot_ms = round(1000 * (1.0 + self.time_s))
                translated = self.translator.see(message)
                if translated is not None:
                    self.listener.hear(*translated, self.translator.boots, self.time_s)
            taken = self.listener.take(self.time_s)
            reading = reading if taken is None else taken.reading
            self.time_s += 0.1
        return reading


def test_what_is_read_of_a_rover() -> None:
    reading = Heard().feed(
        attitude(0, 30.0, 2.0), position(0, 0.0, 0.5), battery(CELLS_MV, 510, 73)
    )
    assert reading["heading_rad"] == pytest.approx(math.radians(60.0))
    assert reading["grade_rad"] == pytest.approx(math.radians(2.0))
    assert reading["speed_mps"] == pytest.approx(0.5 * math.sin(math.radians(30.0)))
    assert (reading["voltage_v"], reading["current_a"], reading["soc"]) == pytest.approx(
        (24.0, 5.1, 0.73)
    )


def test_in_reverse_the_speed_is_negative() -> None:
    assert Heard().feed(attitude(0, 270.0), position(0, 0.0, 0.5))["speed_mps"] == pytest.approx(
        -0.5
    )


@pytest.mark.parametrize(
    ("message", "known"),
    [
        (battery(NO_CELL, -1, -1), set()),
        (battery(CELLS_MV, -1, 50), {"soc"}),  # no current sensor
        (battery(CELLS_MV, 500, -1), {"current_a"}),
        (MAV.MAVLink_sys_status_message(0, 0, 0, 0, UNKNOWN_MV, -1, -1, 0, 0, 0, 0, 0, 0), set()),
        (
            MAV.MAVLink_sys_status_message(0, 0, 0, 0, 24_000, 500, 50, 0, 0, 0, 0, 0, 0),
            {"current_a", "soc"},
        ),
    ],
)
def test_values_that_mean_unknown_are_none(message: Any, known: set[str]) -> None:
    assert {"current_a", "soc"} & set(Heard().feed(position(0, 0.0), message)) == known


def test_a_battery_of_more_than_65_v_comes_in_parts() -> None:
    translated = Translator().see(battery([65_534, 6_466], 100, 50))
    assert translated is not None and translated.content.voltage == pytest.approx(72.0)


def test_without_satellites_the_local_position_is_used() -> None:
    bench = Heard()
    nowhere = position(0, 0.0)
    nowhere.lat = nowhere.lon = 0
    local = MAV.MAVLink_local_position_ned_message(0, 3.0, 4.0, 0.0, 0.0, 1.0, 0.0)
    reading = bench.feed(nowhere, attitude(0, 90.0), local)
    assert (
        reading["position"] == pytest.approx((4.0, 3.0))
        and bench.listener.sources["speed_mps"] == local.get_type()
    )


def test_a_home_that_comes_or_moves_later_moves_no_frame() -> None:
    translator = Translator()
    translator.see(position(0, 300.0))
    translator.see(home())
    for _ in range(2):
        (place,) = (
            one.content.pose.pose.position
            for one in [translator.see(position(0, 300.0))]
            if one is not None
        )
        assert (place.x, place.y) == pytest.approx((300.0, 0.0), abs=0.1)
        translator.fix_frame()
        translator.see(home(LAT_DEG + 100.0 * METRE_DEG))
    late = Translator()
    late.see(position(0, 300.0))
    late.fix_frame()
    late.see(home())
    (place,) = (
        one.content.pose.pose.position for one in [late.see(position(0, 310.0))] if one is not None
    )
    assert place.x == pytest.approx(10.0, abs=0.1)


def test_satellites_found_on_the_way_change_no_frame() -> None:
    translator = Translator()
    local = MAV.MAVLink_local_position_ned_message(0, 3.0, 4.0, 0.0, 0.0, 1.0, 0.0)
    assert translator.see(local) is not None
    translator.fix_frame()
    assert translator.see(position(0, 300.0)) is None and translator.see(local) is not None
    other = Translator()
    assert other.see(position(0, 300.0)) is not None and other.see(local) is None


def test_an_autopilot_that_starts_again_is_another_publisher() -> None:
    translator = Translator()
    for time_ms in (90_000, 89_900, 90_100, 1_000, 1_100):
        translator.see(position(time_ms, 0.0))
    assert translator.boots == 1


def test_a_wind_is_towards_where_it_comes_from() -> None:
    translator = Translator()
    for wind in (
        MAV.MAVLink_wind_message(270.0, 2.0, 0.0),
        MAV.MAVLink_wind_cov_message(0, 0.0, 2.0, 0.0, 0, 0, 0, 0, 0),  # air that moves to the east
        MAV.MAVLink_wind_cov_message(0, math.nan, 2.0, 0.0, 0, 0, 0, 0, 0),
    ):
        translator.see(wind)
    assert len(translator.winds_mps) == 2
    for wind_mps in translator.winds_mps:
        assert wind_mps == pytest.approx((-2.0, 0.0), abs=1e-6)


def test_numbers_have_names_that_fit(advice: Advice) -> None:
    sent = numbers(News(advice, 1.7e6, "husky", [], False))
    assert (
        max(map(len, sent)) <= LONGEST_NAME
        and sent["hw_way_m"] == advice.way_home_m
        and sent["hw_reach"] == 1.0
    )
    assert numbers(News(None, 1.7e6, "husky", [], False)) == {}


@pytest.mark.parametrize("address", ["/dev/no_such_port", "tcp:127.0.0.1:1:2:3"])
def test_an_address_that_cannot_be_opened_takes_one_line(address: str) -> None:
    with pytest.raises(CompanionError, match=r"^cannot open the MAVLink address .*udpin:HOST:PORT"):
        Vehicle(address)


def test_a_link_that_breaks_is_said_until_it_is_there_again(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
        vehicle = Vehicle(f"tcp:127.0.0.1:{address[1]}")
        server.accept()[0].close()
    assert vehicle.take() == [] and vehicle.faults() == ["the link is broken: Connection refused"]
    with socket.create_server(address) as server:
        assert vehicle.take() == [] and vehicle.faults() == []
        server.accept()[0].close()
    vehicle.close()
    assert capfd.readouterr().out == ""


def test_what_does_not_go_together() -> None:
    with pytest.raises(CompanionError, match="--ros2 and --mavlink do not go together"):
        main(Args((), "husky", ros2=True, mavlink="udpin:127.0.0.1:14550"))
    with pytest.raises(CompanionError, match="are for --ros2 and --stdin"):
        main(Args((), "husky", mavlink="udpin:127.0.0.1:14550", home=(0.0, 0.0)))


def test_without_the_extra_a_line_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "homeward.watch.mavlink.vehicle")
    monkeypatch.setitem(sys.modules, "pymavlink", None)
    with pytest.raises(CompanionError, match=r"--mavlink needs pymavlink.*: pip install .*logs"):
        main(Args((), "husky", mavlink="udpin:127.0.0.1:14550"))
