"""The node: messages of a robot go to the companion, and its advice goes back."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from homeward.companion import Advice, Companion, CompanionError
from homeward.companion.saved import DAMAGE, check_sealed, put_values, sealed, values_of
from homeward.files import read_json, write_whole
from homeward.logs.bags.topics import Topics
from homeward.watch import thresholds
from homeward.watch.online.doubted import Doubted
from homeward.watch.online.link import Link, News, Output, can_reach_home
from homeward.watch.online.listener import Heard, Listener

PERIOD_S = 0.1
"""Time over which messages are combined. Chosen: ten updates a second, of 1.5 ms each
(docs/results.md), take 2 % of a core with the messages."""
_PUBLISH_S = 1.0
"""Time after which an advice is published again; an important change is published at once.
Chosen."""


class Node:
    """Subscribes, advises and publishes; call `step` regularly.

    Args:
        companion: Companion of the robot.
        link: What carries the messages.
        mapping: Fields of topics for each channel.
        outputs: Where the advice goes beside the link.

    Attributes:
        advice: The last advice, None before the first.
        warnings: Present warnings, a line each.
        messages: Number of messages received.
    """

    def __init__(
        self,
        companion: Companion,
        link: Link,
        mapping: Topics | None = None,
        outputs: Sequence[Output] = (),
    ) -> None:
        self.companion = companion
        self._link = link
        self._outputs = outputs
        self.listener = Listener(mapping, companion.robot.max_speed_mps)
        self._doubted = Doubted(companion.robot)
        self.advice: Advice | None = None
        self.warnings: list[str] = []
        self.messages = 0
        self._found: dict[str, str] = {}
        self._failures: dict[str, str] = {}  # by what was attempted
        self._heard_s = self._published_s = -1e9
        self._published: tuple[bool, bool] | None = None

    @property
    def found(self) -> dict[str, str]:
        """Topics that may be subscribed, with the types of their messages."""
        return self._found

    @property
    def failures(self) -> list[str]:
        """What failed when it was last attempted, a line each."""
        return list(self._failures.values())

    @property
    def silent(self) -> bool:
        """Whether no motion is received."""
        return time.monotonic() - self._heard_s > thresholds.WITHOUT_MOTION_S

    def step(self) -> bool:
        """Process new messages, and publish what is due; whether there is a new advice.

        Raises:
            RecordingError: The mapping names a field that a message does not have.
        """
        publishers = self._link.found()
        if publishers != self._found:
            self._found = publishers
            self.listener.offer(publishers)
            self._link.subscribe(self.listener.wanted, self.listener.fields)
        now_s = time.monotonic()
        for message in self._link.take():
            self.messages += 1
            if message.topic in self.listener.wanted:
                self.listener.hear(message.topic, message.content, message.publisher, now_s)
        heard = self.listener.take(now_s)
        if heard is not None:
            self._heard_s = now_s
        elif self.advice is not None and self.silent and now_s - self._published_s >= _PUBLISH_S:
            heard = self.listener.silence(now_s)
        if heard is not None:
            self._doubted.see(heard)
            self.attempt("advising", lambda: self._advise(heard))
        advised = self.advice.warnings if self.advice else ()
        self.warnings = [
            *self.failures,
            *self._link.faults(),
            *self.listener.warnings(now_s),
            *self._doubted.lines,
            *advised,
        ]
        self._publish(now_s)
        return heard is not None

    def attempt(self, what: str, act: Callable[[], object]) -> None:
        """Do what may fail for a while, as on a full disk: a failure is a warning until it
        succeeds, and ends nothing.

        Args:
            what: What is done, for the warning.
            act: What does it.
        """
        try:
            act()
        except (OSError, CompanionError) as error:
            self._failures[what] = f"{what} failed: {' '.join(str(error).split())}"
        else:
            self._failures.pop(what, None)

    def _advise(self, heard: Heard) -> None:
        if heard.charged is not None:
            soc = min(max(heard.charged, 0.0), 1.0)
            if heard.by_charger:
                self.companion.charged(soc)
            else:
                self.companion.swap_battery(soc)
        self.advice = self.companion.update(heard.time_s, **heard.reading)

    def _publish(self, now_s: float) -> None:
        important = (
            None if self.advice is None else (can_reach_home(self.advice), self.advice.turn_now)
        )
        if now_s - self._published_s < _PUBLISH_S and important == self._published:
            return
        self._published_s = now_s
        self._published = important
        robot = self.companion.robot
        news = News(self.advice, robot.usable_energy_j, robot.name, self.warnings, self.silent)
        self.attempt("publishing", partial(self._link.tell, news))
        for output in self._outputs:
            self.attempt("streaming", partial(output.tell, news))

    def save(self, path: Path) -> None:
        """Write the state for a restart.

        Raises:
            OSError: It cannot be written.
        """
        state = sealed({
            "companion": self.companion.state(), "listener": values_of(self.listener), "link": values_of(self._link),
            "time_s": self.listener.stamps.without(time.monotonic()), "unix_s": time.time(),
        })  # fmt: skip
        write_whole(path, json.dumps(state) + "\n")

    def load(self, path: Path) -> None:
        """Continue from a file that `save` wrote. The time since then has passed, by this
        computer's clock.

        Raises:
            CompanionError: It is damaged, or of another version or other arguments; nothing has
                changed.
            OSError: It cannot be read.
        """
        try:
            state = read_json(path)
            check_sealed(state)
            of_link = state["link"]  # before anything changes
            self.companion.restore(state["companion"])
            put_values(self.listener, state["listener"])
            put_values(self._link, of_link)
            self.listener.stamps.time_s = state["time_s"] + max(time.time() - state["unix_s"], 0.0)
        except DAMAGE as error:
            raise CompanionError(f"the state in {path} cannot be used: {error}") from None
