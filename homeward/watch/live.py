"""The live view in a terminal: battery, way home, point of no return, and the last warnings."""

from __future__ import annotations

import time
from types import TracebackType

from rich import box
from rich.console import Console
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from homeward import quantities
from homeward.companion import Advice, UncertainValue
from homeward.companion.advice import HOME

_PER_S = 8.0
"""Frames a second. Chosen: motion looks continuous."""
_WARNINGS = 4
"""Number of warnings shown; of those that differ only in numbers, the last. Chosen: a short
panel."""


def view(name: str, advice: Advice, since_s: float, full_j: float, said: tuple[str, ...]) -> Panel:
    """One frame.

    Args:
        name: Name of the robot or its recording.
        advice: The companion's advice.
        since_s: Time since the start, s.
        full_j: Energy of a full battery by the robot's file, J.
        said: The last warnings, with the time of each.
    """
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim")
    grid.add_column(min_width=42)
    share_left = max(min(advice.energy_left_j.mean / full_j, 1.0), 0.0)
    share_home = max(min(advice.energy_home_j.mean / full_j, 1.0), 0.0)
    colour = "green" if share_left > share_home else "red"
    grid.add_row("battery", _with_bar(share_left, _between(advice.energy_left_j), colour))
    way_home = f"{_between(advice.energy_home_j)}, {quantities.distance(advice.way_home_m)}"
    is_home = advice.home == HOME
    grid.add_row(
        Text("way home" if is_home else f"way to {advice.home}"),
        _with_bar(share_home, way_home, "cyan"),
    )
    destination = "home" if is_home else "there"
    grid.add_row(f"probability of getting {destination}", Text(f"{advice.chance_home:.2%}"))
    for option in advice.others:
        way = f"{quantities.energy(option.energy_j.mean)}, {quantities.distance(option.way_m)}, {option.chance:.2%}"
        grid.add_row(Text(f"or {option.name}"), Text(way, style="" if option.reachable else "red"))
    if advice.turn_now:
        grid.add_row("point of no return", Text("TURN NOW", style="bold red"))
    else:
        within = (
            f"in {quantities.distance(advice.turn_in_m)}, {quantities.duration(advice.turn_in_s)}"
        )
        grid.add_row("point of no return", Text(f"{within} (risk {advice.risk:g})"))
    for warning in said:
        grid.add_row("warning", Text(warning, style="yellow"))
    return Panel(
        grid, title=Text(f"{name}: {quantities.duration(since_s)}"), box=box.ROUNDED, width=86
    )


def _with_bar(share: float, text: str, style: str) -> Table:
    rows = Table.grid()  # because a bar does not end its line
    rows.add_row(ProgressBar(total=1.0, completed=share, width=40, complete_style=style))
    rows.add_row(Text(text))
    return rows


def _between(value: UncertainValue) -> str:
    return f"{quantities.energy(value.mean)} ({quantities.energy(value.low)} to {quantities.energy(value.high)})"


def kind_of(warning: str) -> str:
    """A warning without its numbers, so that a counting one is not shown as a new one."""
    return "".join(sign for sign in warning if not sign.isdigit())


class LiveView:
    """Shows advice as it arrives, a few frames a second.

    Args:
        console: Terminal.
        full_j: Energy of a full battery by the robot's file, J.
        speed: Multiple of the recorded speed; 0: as fast as possible.
    """

    def __init__(self, console: Console, full_j: float, speed: float = 0.0) -> None:
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._full_j = full_j
        self._speed = speed
        self._drawn_s = 0.0
        self._begun_s = time.monotonic()
        # by kind: when it was first said so, and what
        self._said: dict[str, tuple[float, str]] = {}
        self._name = ""

    def __enter__(self) -> LiveView:
        self._live.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._live.__exit__(kind, error, trace)

    def show(self, name: str, advice: Advice, since_s: float, duration_s: float) -> None:
        """Show an advice, if a frame is due."""
        if name != self._name:
            self._name = name
            self._begun_s = time.monotonic()
            self._said.clear()
        for text in advice.warnings:
            kind = kind_of(text)
            if kind not in self._said and len(self._said) == _WARNINGS:
                del self._said[next(iter(self._said))]
            _, shown = self._said.get(kind, (0.0, ""))
            if shown != text:
                self._said[kind] = since_s, text
        if self._speed > 0.0:
            time.sleep(max(self._begun_s + since_s / self._speed - time.monotonic(), 0.0))
        now_s = time.monotonic()
        if now_s - self._drawn_s >= 1.0 / _PER_S or since_s >= duration_s:
            self._drawn_s = now_s
            said = tuple(
                f"{quantities.duration(at_s)}: {text}" for at_s, text in self._said.values()
            )
            self._live.update(view(name, advice, since_s, self._full_j, said), refresh=True)
