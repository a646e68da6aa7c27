"""Foxglove's own protocol and file: a WebSocket client and a reader of MCAP find the values that
the advice had."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import socket
import struct
import sys
import time
from pathlib import Path
from typing import Any, cast

import pytest

pytest.importorskip("foxglove", reason="needs the extra foxglove")

from mcap.reader import make_reader
from tornado.websocket import WebSocketClientConnection, websocket_connect

from homeward.commands.watch import Args, main
from homeward.companion import Companion, CompanionError
from homeward.watch.foxglove.stream import (
    ADVICE,
    LAYOUT,
    SCHEMA,
    TEXTS,
    Stream,
    address_of,
    content_of,
)
from homeward.watch.online.link import Link, News
from homeward.watch.online.node import Node
from homeward.watch.ros2.advice_messages import messages

_LONGEST_S = 10.0
_SUBPROTOCOL = "foxglove.sdk.v1"
_MESSAGE_DATA = struct.Struct("<BIQ")  # opcode 1, subscription, time in ns; then the message


@pytest.fixture(scope="module")
def news() -> News:
    """Of a robot with docks, 100 m from home, that nothing was heard of for a while."""
    companion = Companion("husky", home=(0.0, 0.0), docks={"bay": (30.0, 0.0)})
    companion.update(0.0, position=(100.0, 0.0))
    advice = companion.update(1.0, position=(100.0, 0.0))
    return News(
        advice, companion.robot.usable_energy_j, "husky", ["nothing on /odom for 3 s"], True
    )


async def _json_of(client: WebSocketClientConnection) -> Any:
    content = await client.read_message()
    assert isinstance(content, str)
    return json.loads(content)


async def _received(
    stream: Stream, news: News, at_ns: int
) -> dict[str, tuple[dict[str, Any], int, bytes]]:
    """What a client receives of an advice, by topic: the channel, the time and the message."""
    assert stream.url is not None
    client = await websocket_connect(stream.url, subprotocols=[_SUBPROTOCOL])
    assert client.selected_subprotocol == _SUBPROTOCOL
    assert (await _json_of(client))["name"] == "husky"
    channels = {channel["id"]: channel for channel in (await _json_of(client))["channels"]}
    asked = [{"id": number, "channelId": number} for number in channels]
    await client.write_message(json.dumps({"op": "subscribe", "subscriptions": asked}))
    while not (stream._advice.has_sinks() and stream._log.has_sinks()):
        await asyncio.sleep(0.01)
    stream.tell(news, at_ns)
    received = {}
    for _ in channels:
        content = await client.read_message()
        assert isinstance(content, bytes)
        opcode, subscription, time_ns = _MESSAGE_DATA.unpack_from(content)
        assert opcode == 1
        received[channels[subscription]["topic"]] = (
            channels[subscription],
            time_ns,
            content[_MESSAGE_DATA.size :],
        )
    client.close()
    await client.read_message()  # until it is closed
    return received


def test_a_client_reads_the_values_of_the_advice(news: News) -> None:
    stream = Stream("husky", ("127.0.0.1", 0))
    received = asyncio.run(asyncio.wait_for(_received(stream, news, 12 * 10**9), _LONGEST_S))
    stream.close()
    channel, time_ns, content = received[ADVICE]
    assert (channel["encoding"], channel["schemaName"], time_ns) == (
        "json",
        "homeward.Advice",
        12 * 10**9,
    )
    said, advice = json.loads(content), news.advice
    assert advice is not None
    for name in ("energy_left_j", "energy_home_j", "margin_j"):
        spread = getattr(advice, name)
        assert said[name] == {
            "mean": spread.mean,
            "sd": spread.sd,
            "low": spread.low,
            "high": spread.high,
        }
    for name in ("way_home_m", "chance_home", "turn_in_m", "turn_in_s", "turn_now", "home"):
        assert said[name] == getattr(advice, name)
    assert said["warnings"] == news.warnings and said["silent"] and said["can_reach_home"]
    assert (
        [other["name"] for other in said["others"]] == [other.name for other in advice.others] != []
    )
    channel, _, content = received[TEXTS]
    assert channel["schemaName"] == "foxglove.Log" and b"nothing on /odom for 3 s" in content


def test_the_schema_has_the_fields_that_are_published(news: News) -> None:
    said = json.loads(json.dumps(content_of(news), allow_nan=False))
    assert said.keys() == SCHEMA["properties"].keys()
    assert said["others"][0].keys() == SCHEMA["properties"]["others"]["items"]["properties"].keys()
    assert said["margin_j"].keys() == SCHEMA["properties"]["margin_j"]["properties"].keys()


def _written(path: Path) -> list[tuple[str, int, dict[str, Any] | None]]:
    """Topic, time and, of the advice, content of the messages of an MCAP file."""
    with path.open("rb") as file:
        return [
            (
                channel.topic,
                message.log_time,
                json.loads(message.data) if channel.topic == ADVICE else None,
            )
            for _, channel, message in make_reader(file).iter_messages()
        ]


def test_replays_are_written_one_after_the_other_with_the_times_of_the_recordings(
    tmp_path: Path, news: News
) -> None:
    path, advice = tmp_path / "advice.mcap", news.advice
    assert advice is not None
    stream = Stream("husky", path=path)
    tell = stream.replay(news.full_j)
    for name, times_s in {"a.csv": (0.0, 1.0, 2.5), "b.csv": (0.0, 1.0)}.items():
        for since_s in times_s:
            tell(
                name,
                dataclasses.replace(advice, time_s=since_s, warnings=(f"{name} is odd",)),
                since_s,
                9.0,
            )
    stream.close()
    written = _written(path)
    began_ns = written[0][1]
    told = [
        (1e-9 * (time_ns - began_ns), content)
        for topic, time_ns, content in written
        if topic == ADVICE
    ]
    assert [at_s for at_s, _ in told] == pytest.approx([0.0, 1.0, 2.5, 2.5, 3.5])
    assert [content["time_s"] for _, content in told if content] == [0.0, 1.0, 2.5, 0.0, 1.0]
    assert [topic for topic, _, _ in written].count(TEXTS) == 2  # each warning once
    with pytest.raises(
        CompanionError, match=f"--mcap {path} exists, and nothing is written over it"
    ):
        Stream("husky", path=path)


def test_a_node_tells_its_outputs_and_a_full_disk_is_said(
    news: News, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("homeward.watch.foxglove.stream._FLUSHED_S", 0.0)
    monkeypatch.setattr("foxglove.open_mcap", _open_full)
    stream = Stream("husky", path=Path("full.mcap"))
    node = Node(Companion("husky"), cast(Link, _Nothing()), outputs=[stream])
    node.advice = news.advice
    node._publish(time.monotonic())
    (said,) = node.failures
    assert said.startswith("streaming failed: --mcap full.mcap cannot be written: ")
    with pytest.raises(CompanionError, match="cannot be written"):
        stream.close()


class _Nothing:
    """A link that carries nothing."""

    def tell(self, news: News) -> None:
        pass


def _open_full(path: Path, **keywords: Any) -> Any:
    from foxglove._foxglove_py import open_mcap

    return open_mcap("/dev/full", allow_overwrite=True, **keywords)


def _paths(layout: dict[str, Any]) -> list[str]:
    """Topics and message paths that the panels of a layout name."""
    paths = []
    for panel in layout["configById"].values():
        paths += [series["value"] for series in panel.get("paths", [])]
        paths += [panel[name] for name in ("path", "topicToRender") if name in panel]
    return paths


def _panels(place: str | dict[str, Any]) -> list[str]:
    return [place] if isinstance(place, str) else _panels(place["first"]) + _panels(place["second"])


@pytest.mark.parametrize("name", ["layout.json", "layout_ros2.json"])
def test_every_path_of_a_layout_is_published(name: str, news: News) -> None:
    published: dict[str, Any] = {ADVICE: content_of(news), TEXTS: {}}
    if "ros2" in name:
        published = {topic: content for topic, _, content in messages(*news, namespace="")}
    layout = json.loads(LAYOUT.with_name(name).read_text("utf-8"))
    assert sorted(_panels(layout["layout"])) == sorted(layout["configById"])
    paths = _paths(layout)
    assert len(paths) >= len(layout["configById"])
    for path in paths:
        topic, *fields = path.split(".")
        value = published[topic]
        for field in fields:
            value = value[field]
        assert fields == [] or isinstance(value, int | float), path
    if "ros2" in name:
        (panel,) = (panel for panel in layout["configById"].values() if "selectedName" in panel)
        assert panel["selectedName"] == published["/diagnostics"]["status"][0]["name"]


def test_bad_input_takes_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CompanionError, match=r"'8765' is no address; give HOST:PORT"):
        address_of("8765")
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(CompanionError, match="--foxglove-address"),
    ):
        Stream("husky", taken.getsockname())
    with pytest.raises(CompanionError, match="cannot be written: No such file"):
        Stream("husky", path=tmp_path / "missing" / "a.mcap")
    with pytest.raises(CompanionError, match="--foxglove is for a live robot; --mcap FILE"):
        main(Args((tmp_path / "run.csv",), "husky", foxglove=True))
    monkeypatch.delitem(sys.modules, "homeward.watch.foxglove.stream")
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(
        CompanionError, match=r"--foxglove needs foxglove-sdk: pip install .*foxglove"
    ):
        main(Args((), "husky", stdin=True, foxglove=True))
