"""The score as tables, for the terminal and for Markdown, and as data."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from rich.table import Table

from benchmarks.scoring.outcome import Outcome
from benchmarks.scoring.score import Headline, Rate, confusion, failures, headlines, of_kind, rate, rows


@dataclass(frozen=True)
class Grid:
    """A table of texts."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def rich(self) -> Table:
        """For the terminal."""
        table = Table(title=self.title)
        for heading in self.headings:
            table.add_column(heading, overflow="fold")
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        """For a page of the documentation."""
        lines = (self.headings, ("---",) * len(self.headings), *self.rows)
        cells = ("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        return "\n".join((f"## {self.title}", "", *cells, ""))


def grids(outcomes: Sequence[Outcome]) -> list[Grid]:
    """All tables of a score, in the order in which they are read."""
    return [
        _headlines(outcomes), _by_effect(outcomes), _pairs(outcomes), _confusion(outcomes), _reasons(outcomes),
        _failures(outcomes), _times(outcomes),
    ]  # fmt: skip


def as_data(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """What score.json holds."""
    return {
        "schema": 1,
        "cases": len(outcomes),
        "headlines": [
            {"what": one.what, **_rate(one.rate), "median": one.middle, "target": one.target, "met": one.met}
            for one in headlines(outcomes)
        ],
        "effects": [
            {key: _rate(value) if isinstance(value, Rate) else value for key, value in _fields(row).items()}
            for row in rows(outcomes)
        ],
        "confusion": confusion(outcomes),
        "failures": [_fields(one) for one in failures(outcomes)],
        "each": [
            {
                "name": one.truth.name, "source": one.truth.source, "kind": one.truth.kind, "truth": one.truth.truth,
                "noise": one.truth.noise, "verdict": one.verdict, "named": one.names, "right": one.is_right,
                "f1": one.location_f1, "error_fell": one.error_fell, "elapsed_s": one.aside.elapsed_s,
                "cpu_s": one.aside.cpu_s,
            }
            for one in outcomes
        ],
    }  # fmt: skip


def _rate(value: Rate) -> dict[str, Any]:
    return {"hits": value.hits, "of": value.of, "share": value.share, "ci95": value.ci95}


def _fields(one: Any) -> dict[str, Any]:
    return {field.name: getattr(one, field.name) for field in dataclasses.fields(one)}


def _headlines(outcomes: Sequence[Outcome]) -> Grid:
    told = {None: "", True: "met", False: "missed"}
    return Grid(
        "Against the targets",
        ("what", "share (cases; 95 % interval)", "median", "target", ""),
        tuple(
            (one.what, str(one.rate), _number(one.middle), _target(one), told[one.met]) for one in headlines(outcomes)
        ),
    )


def _target(one: Headline) -> str:
    if one.target is None:
        return ""
    target = f"{one.target:.0%}" if one.middle is None else f"median {one.target:g}"
    return f"at {'most' if one.at_most else 'least'} {target}"


def _by_effect(outcomes: Sequence[Outcome]) -> Grid:
    return Grid(
        "Single effects",
        ("effect", "noise", "cases", "first", "class holds it", "class size", "anywhere", "F1, median", "error fell"),
        tuple(
            (row.effect, row.noise, str(row.first.of), _share(row.first), _share(row.in_class),
             _number(row.class_size), _share(row.anywhere), _number(row.f1), _share(row.error_fell))
            for row in rows(outcomes)
        ),
    )  # fmt: skip


def _pairs(outcomes: Sequence[Outcome]) -> Grid:
    pairs: dict[str, list[Outcome]] = {}
    for one in of_kind(outcomes, "pair"):
        pairs.setdefault(" + ".join(sorted(one.truth.truth)), []).append(one)
    return Grid(
        "Pairs",
        ("effects", "cases", "both found", "both in some class", "error fell"),
        tuple(
            (pair, str(len(group)), _share(rate(group, lambda one: one.both_found)),
             _share(rate(group, lambda one: one.both_mentioned)), _share(rate(group, lambda one: one.error_fell)))
            for pair, group in sorted(pairs.items())
        ),
    )  # fmt: skip


def _confusion(outcomes: Sequence[Outcome]) -> Grid:
    return Grid(
        "What was named first, of single effects and controls",
        ("hidden", "named first"),
        tuple(
            (row, ", ".join(f"{column} {count}" for column, count in counts.items()))
            for row, counts in confusion(outcomes).items()
        ),
    )


def _reasons(outcomes: Sequence[Outcome]) -> Grid:
    often = Counter((one.kind, one.reason) for one in failures(outcomes))
    truths = {key: Counter(f.truth for f in failures(outcomes) if (f.kind, f.reason) == key) for key in often}
    return Grid(
        "Why cases failed",
        ("cases", "kind", "reason", "hidden"),
        tuple(
            (str(count), *key, ", ".join(f"{truth} {n}" for truth, n in truths[key].most_common()))
            for key, count in often.most_common()
        ),
    )


def _failures(outcomes: Sequence[Outcome]) -> Grid:
    return Grid(
        "Cases that failed",
        ("case", "source", "kind", "hidden", "noise", "verdict", "named [confused with]", "reason", "absorbed",
         "hidden effect alone"),
        tuple(tuple(str(value) for value in _fields(one).values()) for one in failures(outcomes)),
    )  # fmt: skip


def _times(outcomes: Sequence[Outcome]) -> Grid:
    found = []
    for source in sorted({one.truth.source for one in outcomes}):
        asides = [one.aside for one in outcomes if one.truth.source == source]
        elapsed_s = [one.elapsed_s for one in asides]
        cpu_s = median(one.cpu_s for one in asides)
        found.append((source, str(len(asides)), f"{median(elapsed_s):.1f}", f"{max(elapsed_s):.1f}", f"{cpu_s:.1f}"))
    return Grid("Seconds a case", ("source", "cases", "median", "longest", "median of the processor's"), tuple(found))


def _share(value: Rate) -> str:
    return "-" if value.share is None else f"{value.share:.0%}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
