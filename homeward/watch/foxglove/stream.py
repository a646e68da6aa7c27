"""The advice on two topics, by Foxglove's WebSocket server and in an MCAP file.

`/homeward/advice` has the numbers of an advice, as JSON with the names of
`homeward.companion.Advice`, and `/homeward/texts` orders and warnings when they change, as
`foxglove.Log`.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import foxglove
from foxglove.channels import LogChannel
from foxglove.messages import Log, LogLevel, Timestamp

from homeward.companion import Advice, CompanionError
from homeward.watch.online.link import News, can_reach_home, reserve
from homeward.watch.online.texts import Severity, Texts

ADVICE, TEXTS = "/homeward/advice", "/homeward/texts"
LOOPBACK = "127.0.0.1"
LAYOUT = Path(__file__).with_name("layout.json")
"""A layout of Foxglove for both."""

_FLUSHED_S = 60.0
"""Time between writes to the file. Chosen: a power cut loses a minute, as of the saved state."""
_NANO = 10**9
_LEVELS = {
    Severity.ALERT: LogLevel.Fatal, Severity.CRITICAL: LogLevel.Error, Severity.WARNING: LogLevel.Warning,
    Severity.NOTICE: LogLevel.Info,
}  # fmt: skip

_NUMBER, _TEXT, _FLAG = {"type": "number"}, {"type": "string"}, {"type": "boolean"}
_TEXT_LIST = {"type": "array", "items": _TEXT}
_SPREAD = {"type": "object", "properties": dict.fromkeys(("mean", "sd", "low", "high"), _NUMBER)}
_OTHER = {
    "name": _TEXT, "way_m": _NUMBER, "energy_j": _SPREAD, "margin_j": _SPREAD, "chance": _NUMBER, "reachable": _FLAG,
}  # fmt: skip
SCHEMA: dict[str, Any] = {
    "title": "homeward.Advice",
    "type": "object",
    "properties": {
        **dict.fromkeys(("energy_left_j", "energy_home_j", "margin_j"), _SPREAD),
        **dict.fromkeys(
            ("time_s", "way_home_m", "chance_home", "risk", "turn_in_m", "turn_in_s"), _NUMBER
        ),
        **dict.fromkeys(("chance_there_and_back", "reserve", "full_j"), _NUMBER),
        **dict.fromkeys(("turn_now", "can_reach_home", "looks_back", "silent"), _FLAG),
        **dict.fromkeys(("rests_on", "warnings"), _TEXT_LIST),
        "home": _TEXT,
        "others": {"type": "array", "items": {"type": "object", "properties": _OTHER}},
        "action": {
            "type": "object",
            "properties": {"speed_mps": _NUMBER, "sensing_hz": _NUMBER, "mode": _TEXT},
        },
    },
}
"""JSON schema of the advice: Foxglove lists the paths by it."""

# what fails is said here, in one line; the library would say it at each message
foxglove.set_log_level("CRITICAL")


def content_of(news: News) -> dict[str, Any]:
    """Fields of the advice by their names; `warnings` are all present ones."""
    assert news.advice is not None
    advice = dataclasses.replace(news.advice, warnings=tuple(news.warnings))
    return advice.to_json() | {
        "can_reach_home": can_reach_home(advice), "reserve": reserve(advice, news.full_j), "full_j": news.full_j,
        "silent": news.silent,
    }  # fmt: skip


def address_of(text: str) -> tuple[str, int]:
    """Host and port of `HOST:PORT`.

    >>> address_of("127.0.0.1:8765"), address_of("[::1]:0")
    (('127.0.0.1', 8765), ('::1', 0))

    Raises:
        CompanionError: It is none.
    """
    host, _, port = text.rpartition(":")
    if not host or not (port.isascii() and port.isdecimal()) or int(port) >= 2**16:
        raise CompanionError(
            f"--foxglove-address {text!r} is no address; give HOST:PORT, such as {LOOPBACK}:8765"
        )
    return host.strip("[]"), int(port)


class Stream:
    """Publishes an advice to Foxglove.

    Args:
        robot: Name of the robot, which Foxglove shows.
        address: Host and port of the server; port 0 is a free one. None: no server.
        path: MCAP file to write. None: no file.

    Attributes:
        url: Address that Foxglove connects to; None without a server.

    Raises:
        CompanionError: The address cannot be listened at, or the file exists or cannot be written.
    """

    def __init__(
        self, robot: str, address: tuple[str, int] | None = None, path: Path | None = None
    ) -> None:
        self._context = foxglove.Context()
        self._texts = Texts()
        self._path = path
        self._flushed_s = time.monotonic()
        self._server = self._file = None
        self.url: str | None = None
        if path is not None:
            try:
                self._file = foxglove.open_mcap(path, context=self._context)
            except FileExistsError:
                raise CompanionError(
                    f"--mcap {path} exists, and nothing is written over it; name another"
                ) from None
            except OSError as error:
                raise CompanionError(f"--mcap {path} cannot be written: {error}") from None
        if address is not None:
            host, port = address
            try:
                self._server = foxglove.start_server(
                    name=robot, host=host, port=port, context=self._context
                )
            except RuntimeError as error:  # of which this library makes every fault
                raise CompanionError(
                    f"cannot listen at {host}:{port} ({error}); give another --foxglove-address"
                ) from None
            self.url = f"ws://{f'[{host}]' if ':' in host else host}:{self._server.port}"
        self._advice = foxglove.Channel(ADVICE, schema=SCHEMA, context=self._context)
        self._log = LogChannel(TEXTS, context=self._context)

    def tell(self, news: News, at_ns: int | None = None) -> None:
        """Publish.

        Args:
            news: What there is to tell.
            at_ns: Time of it, ns since 1970; by default now.

        Raises:
            CompanionError: The file cannot be written any more; the server goes on.
        """
        at_ns = time.time_ns() if at_ns is None else at_ns
        if news.advice is not None:
            self._advice.log(content_of(news), log_time=at_ns)
        for severity, text in self._texts.due(news, at_ns / _NANO):
            stamp = Timestamp(*divmod(at_ns, _NANO))
            level = _LEVELS[severity]
            self._log.log(
                Log(timestamp=stamp, level=level, message=text, name=news.robot), log_time=at_ns
            )
        if self._file is not None and time.monotonic() - self._flushed_s >= _FLUSHED_S:
            self._flushed_s = time.monotonic()
            self._write(self._file.flush)

    def replay(self, full_j: float) -> Callable[[str, Advice, float, float], None]:
        """A function that publishes the advice of replays, see `homeward.watch.replay.run_all`.

        The first replay begins now, and each further one where the last has ended.

        Args:
            full_j: Energy of a full battery by the robot's file, J.
        """
        began_ns, last_s = time.time_ns(), 0.0

        def tell(name: str, advice: Advice, since_s: float, _: float) -> None:
            nonlocal began_ns, last_s
            if since_s < last_s:
                began_ns += round(last_s * _NANO)
            last_s = since_s
            news = News(advice, full_j, name, list(advice.warnings), silent=False)
            self.tell(news, began_ns + round(since_s * _NANO))

        return tell

    def _write(self, act: Callable[[], None]) -> None:
        try:
            act()
        except RuntimeError as error:
            raise CompanionError(f"--mcap {self._path} cannot be written: {error}") from None

    def close(self) -> None:
        """Stop the server and finish the file.

        Raises:
            CompanionError: The file could not be finished.
        """
        if self._server is not None:
            self._server.stop()
        if self._file is not None:
            file, self._file = self._file, None
            self._write(file.close)
