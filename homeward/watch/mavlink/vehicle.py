"""A vehicle with an autopilot on a MAVLink link: its messages come in, the advice goes out."""

from __future__ import annotations

import contextlib
import io
import math
import os
import time
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np

from homeward import thresholds as shared
from homeward.companion import CompanionError
from homeward.watch.mavlink.telling import chunks, numbers
from homeward.watch.mavlink.translate import KINDS, Translator, metres_from
from homeward.watch.online.link import Message, News
from homeward.watch.online.texts import Texts

# pymavlink reads it: messages of version 2 are sent, those of both are received
os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

mavutil.set_dialect("ardupilotmega")  # common.xml and ArduPilot's WIND

_SETTLES_S = 2.0
"""Time after the first position in which home and wind are received. Chosen: autopilots send both
each second or so."""
_WAITS_S = 5.0
"""Time without a position after which the reason is said. Chosen."""
_POLL_S = 0.02
_MOST = 2000  # messages taken at a time; chosen: more than a second of any link
_BAUD = 115200  # of a serial port; chosen: that of ArduPilot's and PX4's companion computers
_LAST_ID = 65535  # of a STATUSTEXT in parts
_ONBOARD_COMPUTER = 191  # MAV_COMP_ID_ONBOARD_COMPUTER (common.xml)
_HOME_POSITION = 242  # number of the message


class Met(NamedTuple):
    """What is known of a vehicle before it is advised.

    Attributes:
        home: East and north of home in the frame of its positions, m; None if the autopilot has not
            sent it.
        wind_mps: Mean wind, components towards where it comes from, east and north; None if it was
            not received.
    """

    home: tuple[float, float] | None
    wind_mps: tuple[float, float] | None

    def said(self) -> list[str]:
        """What was assumed, a line each."""
        home = "home is the first position: the autopilot has sent none (HOME_POSITION)"
        if self.home is not None:
            home = "home is the autopilot's"
        if self.wind_mps is None:
            return [home, "no wind was received (WIND, WIND_COV): any wind is possible"]
        east_mps, north_mps = self.wind_mps
        from_deg = math.degrees(math.atan2(east_mps, north_mps)) % 360.0
        return [
            home,
            f"the forecast is the wind received: {math.hypot(*self.wind_mps):.1f} m/s from {from_deg:.0f} degrees",
        ]


class Vehicle:
    """The first vehicle that sends a heartbeat; a `homeward.watch.online.link.Link`.

    Args:
        address: As pymavlink has it: `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT`, or a
            serial port.

    Attributes:
        translator: Its messages, translated.

    Raises:
        CompanionError: The address cannot be opened.
    """

    SAVED: ClassVar[tuple[str, ...]] = ("translator",)

    def __init__(self, address: str) -> None:
        try:
            with _quiet():
                self._connection: Any = mavutil.mavlink_connection(
                    address,
                    baud=_BAUD,
                    source_component=_ONBOARD_COMPUTER,
                    autoreconnect=True,
                    retries=1,
                )
        except ModuleNotFoundError:
            raise CompanionError(
                f"cannot open the MAVLink address {address!r}: a serial port needs pyserial (pip install pyserial); "
                "other addresses are udpin:HOST:PORT, udpout:HOST:PORT and tcp:HOST:PORT"
            ) from None
        except Exception as error:  # pymavlink raises anything, from OSError to SerialException
            why = " ".join(str(error).split()) or type(error).__name__
            raise CompanionError(
                f"cannot open the MAVLink address {address!r} ({why}); give udpin:HOST:PORT, udpout:HOST:PORT, "
                "tcp:HOST:PORT or a serial port"
            ) from None
        self.translator = Translator()
        self._vehicle: tuple[int, int] | None = None  # numbers of system and component
        self._others: set[int] = set()
        self._broken = ""
        self._found: dict[str, str] = {}
        self._texts = Texts()
        self._text_id = 0
        self._beaten_s = -math.inf

    def meet(self, waiting: Callable[[str], None]) -> Met:
        """Wait for a position, then for home and wind a moment longer.

        Args:
            waiting: Is told, once, what is missing.
        """
        began_s = time.monotonic()
        placed_s = math.inf
        said = False
        while time.monotonic() - placed_s < _SETTLES_S:
            for message in self.take():
                if placed_s == math.inf and hasattr(message.content, "pose"):
                    placed_s = time.monotonic()
            if not said and placed_s == math.inf and time.monotonic() - began_s > _WAITS_S:
                waiting(
                    f"waiting for a position; received: {', '.join(sorted(self._found)) or self._nothing()}"
                )
                said = True
            with contextlib.suppress(OSError):  # which `faults` says later
                self._send_heartbeat()
            time.sleep(_POLL_S)
        self.translator.fix_frame()
        winds = self.translator.winds_mps
        wind_mps = None
        if winds:
            east_mps, north_mps = np.mean(winds, axis=0)
            wind_mps = float(east_mps), float(north_mps)
        return Met(None if self.translator.home_deg is None else (0.0, 0.0), wind_mps)

    def _nothing(self) -> str:
        return "no heartbeat of an autopilot" if self._vehicle is None else "no reading"

    def found(self) -> dict[str, str]:
        """Messages received so far that are readings, with the types that they are translated
        to."""
        return dict(self._found)

    def subscribe(self, topics: dict[str, str], fields: dict[str, list[str]]) -> None:
        """Nothing: what an autopilot sends is its own setting."""

    def take(self) -> list[Message]:
        """Translated messages since the last call."""
        messages = []
        for _ in range(_MOST):
            try:
                with _quiet():
                    message = self._connection.recv_msg()
            except OSError as error:  # the other end is gone; the next call connects anew
                self._broken = f"the link is broken: {error.strerror or error}"
                break
            self._broken = ""
            if message is None:
                break
            if self._is_vehicle(message):
                translated = self.translator.see(message)
                if translated is not None:
                    self._found[translated.topic] = KINDS[translated.topic]
                    messages.append(
                        Message(translated.topic, translated.content, self.translator.boots)
                    )
        return messages

    def _is_vehicle(self, message: Any) -> bool:
        """Whether a message is of the autopilot that is advised: the first with a heartbeat."""
        sender = message.get_srcSystem(), message.get_srcComponent()
        if (
            message.get_type() == "HEARTBEAT"
            and message.autopilot != mavutil.mavlink.MAV_AUTOPILOT_INVALID
        ):
            if self._vehicle is None:
                self._vehicle = sender
                # a computer on board has the number of its vehicle
                self._connection.mav.srcSystem = sender[0]
                self._ask_for_home()
            elif sender[0] != self._vehicle[0]:
                self._others.add(sender[0])
        return sender == self._vehicle

    def _ask_for_home(self) -> None:
        assert self._vehicle is not None
        ask = mavutil.mavlink.MAV_CMD_REQUEST_MESSAGE
        self._connection.mav.command_long_send(
            *self._vehicle, ask, 0, _HOME_POSITION, 0, 0, 0, 0, 0, 0
        )

    def faults(self) -> list[str]:
        """A broken link, other vehicles on it, and a home that is not the one in use."""
        said = [self._broken] if self._broken else []
        if self._others:
            numbers = ", ".join(map(str, sorted(self._others)))
            said.append(
                f"vehicle {numbers} is on the link too and left out: {self._number()} is advised"
            )
        home_deg = self.translator.home_deg
        origin_deg = self.translator.origin_deg
        if home_deg is not None and origin_deg is not None:
            moved_m = math.hypot(*metres_from(origin_deg, home_deg))
            if moved_m > shared.POSITION_M:
                said.append(
                    f"the autopilot's home is {moved_m:.0f} m from the home in use: start without a state to use it"
                )
        return said

    def _number(self) -> str:
        return "none" if self._vehicle is None else str(self._vehicle[0])

    def tell(self, news: News) -> None:
        """Send a heartbeat, the numbers of the advice, and texts on what has changed.

        Raises:
            OSError: The link is gone.
        """
        self._send_heartbeat()
        mav = self._connection.mav
        now_s = time.monotonic()
        boot_ms = int(1e3 * now_s) % 2**32
        for name, value in numbers(news).items():
            mav.named_value_float_send(boot_ms, name.encode(), value)
        for severity, text in self._texts.due(news, now_s):
            parts = chunks(text)
            if len(parts) > 1:
                self._text_id = self._text_id % _LAST_ID + 1
            for place, part in enumerate(parts):
                mav.statustext_send(severity, part, self._text_id if len(parts) > 1 else 0, place)

    def _send_heartbeat(self) -> None:
        """Once a second, as each part of a vehicle does."""
        now_s = time.monotonic()
        if now_s - self._beaten_s >= 1.0:
            self._beaten_s = now_s
            mavlink = mavutil.mavlink
            self._connection.mav.heartbeat_send(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                mavlink.MAV_AUTOPILOT_INVALID,
                0,
                0,
                mavlink.MAV_STATE_ACTIVE,
            )

    def close(self) -> None:
        """Close the link."""
        self._connection.close()


def _quiet() -> contextlib.AbstractContextManager[object]:
    """Keep what pymavlink prints, as that it connects anew, from the output."""
    return contextlib.redirect_stdout(io.StringIO())
