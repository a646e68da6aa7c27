"""A session of `homeward watch` on live messages: subscribe, advise, show and save, until it is
interrupted."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from homeward import cli, quantities
from homeward.cli import Terminal
from homeward.companion import Companion, CompanionError
from homeward.logs.bags.topics import load_topics
from homeward.physics import Robot
from homeward.watch.live import LiveView, kind_of
from homeward.watch.online.link import Link, Output
from homeward.watch.online.node import PERIOD_S, Node

_SAVED_S = 60.0  # between saved states; chosen: a crash loses a minute at most
_PRINTED_S = 60.0
"""Time between lines if the output is not a terminal. Chosen: 60 lines an hour."""
_WAITS_S = 5.0
"""Time without an advice after which the reason is printed. Chosen: topics are discovered by
then."""
_NAMED = 8
"""Number of unused topics that are named. Chosen: a line or two."""


class Session:
    """Advises a robot as it drives.

    Args:
        robot: The robot.
        link: What carries its messages.
        where: Name of the robot and the link, for the terminal.
        mapping: Mapping of topics, shipped name or TOML file; by default the shipped one that
            covers most.
        home: Home in the frame of the positions, m; by default the first position received.
        state: File of the state: read if it exists, and written every minute and at the end. One
            that cannot be used is left out with a warning.
        outputs: Where the advice goes beside the link.
        keywords: Arguments of the companion.

    Raises:
        CompanionError: An argument is invalid.
        RecordingError: The mapping is invalid.
    """

    def __init__(
        self, robot: Robot, link: Link, where: str, mapping: str | Path | None = None,
        home: tuple[float, float] | None = None, state: Path | None = None, outputs: Sequence[Output] = (),
        **keywords: Any,
    ) -> None:  # fmt: skip
        topics = None if mapping is None else load_topics(mapping)
        companion = Companion(robot, home="here" if home is None else home, **keywords)
        self.node = Node(companion, link, topics, outputs)
        self._where = where
        self._state = state
        if state is not None:
            self._load(state)

    def run(self, console: Terminal, quiet: bool, done: Callable[[], bool] = lambda: False) -> None:
        """Subscribe and advise until it is done or interrupted.

        Raises:
            RecordingError: See `Node.step`.
        """
        began_s = saved_s = time.monotonic()
        full_j = self.node.companion.robot.usable_energy_j
        with contextlib.ExitStack() as stack:
            stack.callback(self._end)
            live = None
            if console.is_terminal and not quiet:
                live = stack.enter_context(LiveView(console, full_j))
            printer = _Printer(console, self.node, self._where)
            while not done():
                now_s = time.monotonic()
                news = self.node.step()
                advice = self.node.advice
                if live is not None and news and advice is not None:
                    shown = dataclasses.replace(advice, warnings=tuple(self.node.warnings))
                    self.node.attempt(
                        "showing",
                        partial(live.show, self._where, shown, advice.time_s, float("inf")),
                    )
                elif not quiet:
                    self.node.attempt(
                        "printing", partial(printer.say, now_s - began_s, live is None)
                    )
                if now_s - saved_s >= _SAVED_S:
                    saved_s = now_s
                    self._save()
                time.sleep(max(now_s + PERIOD_S - time.monotonic(), 0.0))

    def _load(self, state: Path) -> None:
        try:
            self.node.load(state)
        except FileNotFoundError:
            return  # the first start
        except (OSError, CompanionError) as error:
            text = (
                f"begun without the state: {error}; without --home, home is where the robot is now"
            )
            cli.remark(self._where, text)
            self.node.listener.say(text, time.monotonic())

    def _end(self) -> None:
        """Save, and say what cannot be shown any more."""
        self._save()
        for text in self.node.failures:
            with contextlib.suppress(OSError):  # nothing is left to say it to
                cli.remark(self._where, text)

    def _save(self) -> None:
        if self._state is not None and self.node.advice is not None:
            self.node.attempt("saving the state", partial(self.node.save, self._state))


class _Printer:
    """Prints important events, a line each: missing topics and, without a live view, the advice."""

    def __init__(self, console: Terminal, node: Node, where: str) -> None:
        self._console = console
        self._node = node
        self._where = where
        self._waited: dict[str, str] | None = None
        self._sources: dict[str, str] = {}
        self._turns: bool | None = None
        self._printed_s = 0.0
        self._warned: set[str] = set()

    def say(self, since_s: float, all_of_it: bool) -> None:
        """Print what is new.

        Args:
            since_s: Time since the start, s.
            all_of_it: Whether the advice is printed too, as there is no live view.
        """
        advice = self._node.advice
        if advice is None:
            if since_s > _WAITS_S and self._node.found != self._waited:
                self._waited = dict(self._node.found)
                self._print(f"{self._where}: waiting for motion; {self._heard()}")
            return
        if not all_of_it:
            return
        if self._node.listener.sources != self._sources:
            self._sources = dict(self._node.listener.sources)
            self._print(
                f"topic mapping {self._node.listener.mapping_name}: {self._channels_by_topic()}"
            )
        for text in self._node.warnings:
            if kind_of(text) not in self._warned:
                self._print(f"{quantities.duration(since_s)}: {text}")
        self._warned = set(map(kind_of, self._node.warnings))
        if advice.turn_now != self._turns or since_s - self._printed_s >= _PRINTED_S:
            self._turns = advice.turn_now
            self._printed_s = since_s
            self._print(f"{quantities.duration(since_s)}: {advice}")

    def _print(self, text: str) -> None:
        self._console.print(text, soft_wrap=True)

    def _channels_by_topic(self) -> str:
        """Which channels come from which topic, in words."""
        channels: dict[str, list[str]] = {}
        for channel, topic in self._sources.items():
            channels.setdefault(topic, []).append(channel)
        return "; ".join(
            f"{', '.join(of_topic)} from {topic}" for topic, of_topic in channels.items()
        )

    def _heard(self) -> str:
        """The subscribed topics, and others."""
        wanted = self._node.listener.wanted
        offered = [(name, f"{name} ({kind})") for name, kind in sorted(self._node.found.items())]
        in_use = [words for name, words in offered if name in wanted]
        not_in_use = [words for name, words in offered if name not in wanted]
        others_note = f"; {len(not_in_use)} other topics"
        if not_in_use:
            others_note += f", such as {', '.join(not_in_use[:_NAMED])}"
        by_mapping = f"subscribed by the topic mapping {self._node.listener.mapping_name}"
        return f"{by_mapping}: {', '.join(in_use) or 'none'}{others_note}"
