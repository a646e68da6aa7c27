"""Tables of figures with 95 % intervals, as benchmarks print them."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.table import Table

from homeward.agents.evaluation.statistics import wilson


def table(title: str, left: Sequence[str], right: Sequence[str]) -> Table:
    """A table without rows: names in its first columns, aligned left, and figures in the others."""
    made = Table(title=title, box=box.SIMPLE_HEAD)
    for heading in left:
        made.add_column(heading)
    for heading in right:
        made.add_column(heading, justify="right")
    return made


def span(value: float, ends: Sequence[float], style: str) -> str:
    """A figure with its interval.

    >>> span(0.5, (0.25, 1.0), ".0%")
    '50% (25% to 100%)'
    """
    return "{:{style}} ({:{style}} to {:{style}})".format(value, *ends, style=style)


def rate(events: int, trials: int, style: str = ".2%") -> str:
    """Rate of an event, with Wilson's interval."""
    return span(events / trials, wilson(events, trials), style)
