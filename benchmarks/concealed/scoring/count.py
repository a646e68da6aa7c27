"""Counts over outcomes, with Wilson intervals, as tables."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.plants.cases import NEEDS
from benchmarks.concealed.plants.effects import EFFECTS, INSTRUMENTS
from benchmarks.concealed.plants.instruments import NOISES
from benchmarks.concealed.scoring.outcome import MODELS, USABLE_ENERGY, Interval, Outcome
from homeward.agents.evaluation.statistics import wilson

NAMES_GRADE = re.compile(r"grade|elevation|slope|altitude|hills?\b", re.IGNORECASE)
NOT_SAID = ("wind", "intermittent_load")
"""Effects that a robot file cannot contain: weather, and a periodic load of unknown phase."""


def share(flags: Iterable[bool]) -> str:
    """Count, total and share with its 95 % interval.

    >>> share([True, False, True, True])
    '3/4 = 75 % (30–95)'
    """
    listed = list(flags)
    if not listed:
        return "–"
    hits, of = sum(listed), len(listed)
    low, high = wilson(hits, of)
    return f"{hits}/{of} = {100 * hits / of:.0f} % ({100 * low:.0f}–{100 * high:.0f})"


@dataclass(frozen=True)
class Table:
    """A title, the names of the columns, and rows of text."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]

    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [f"### {self.title}", "", "| " + " | ".join(self.columns) + " |", "|" + "---|" * len(self.columns)]
        return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in self.rows), ""])


def named(outcome: Outcome) -> list[list[str]]:
    """Named classes; a capacity that is too small in all drives counts as ageing or one of its stated alternatives."""
    return [*outcome.classes, *([outcome.capacity] if outcome.capacity else [])]


def found_first(outcome: Outcome) -> bool:
    """Whether the concealed effect is the first named one, or one that it is stated to be confused with."""
    return outcome.hidden[0] in [*named(outcome), []][0]


def usable(outcome: Outcome) -> bool:
    """Whether a control's recordings identify its parameters: not with power of the wrong sign or unrecorded hills."""
    return outcome.fault not in ("wrong_sign", "no_grade")


def false_alarm(outcome: Outcome) -> bool:
    """Whether the diagnosis of a control names physics; without a grade channel it may ask for that channel."""
    if outcome.verdict == "unknown_physics" and outcome.fault == "no_grade":
        return not NAMES_GRADE.search(outcome.summary)
    return outcome.verdict in ("missing_physics", "unknown_physics")


def wrongly_named(outcome: Outcome) -> bool:
    """Whether a mechanism outside the catalogue was named as an effect that is no acceptable description of it."""
    fair = set(outcome.fair)
    return any(entry[0] in EFFECTS and not fair & set(entry) for entry in outcome.classes)


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """All tables with outcomes."""
    made: list[Table] = []
    makers: dict[str, Callable[[list[Outcome]], Table]] = {
        "singles": _singles, "pairs": _pairs, "controls": _controls, "outside": _outside, "coverage": _coverage,
    }  # fmt: skip
    for part in (None, *NEEDS):  # those of other simulators apart from the own one
        for kind, maker in makers.items():
            chosen = [o for o in outcomes if o.kind == kind and part == (o.part if o.part in NEEDS else None)]
            if chosen:
                table = maker(chosen)
                made.append(dataclasses.replace(table, title=f"{table.title}, {part}" if part else table.title))
    hidden = [outcome for outcome in outcomes if outcome.part in ("singles", "pairs")]
    return [*made, *(_later(hidden) if hidden else [])]


def _singles(outcomes: list[Outcome]) -> Table:
    columns = ("", "found first", "of these visible", *NOISES, "provable at best", "first by name",
               "visible but no mismatch", "class size")  # fmt: skip

    def row(name: str, chosen: list[Outcome]) -> tuple[str, ...]:
        visible = [o for o in chosen if all(o.visible.values())]
        levels = [share(found_first(o) for o in chosen if o.label == level) for level in NOISES]
        by_name = share(bool(o.classes) and o.classes[0][0] == o.hidden[0] for o in chosen)
        blind = share(o.verdict in ("no_mismatch", "parameters_off", "not_testable") for o in visible)
        found = share(map(found_first, chosen)), share(map(found_first, visible))
        sizes = [len(o.classes[0]) for o in chosen if o.classes]
        return (name, *found, *levels, _provable(chosen), by_name, blind, f"{np.mean(sizes):.2f}" if sizes else "–")

    rows = [row("all", outcomes), row("physics", [o for o in outcomes if o.hidden[0] not in INSTRUMENTS])]
    rows.append(row("instruments", [o for o in outcomes if o.hidden[0] in INSTRUMENTS]))
    by_effect = {effect: [o for o in outcomes if o.hidden[0] == effect] for effect in EFFECTS}
    rows += [row(effect, chosen) for effect, chosen in by_effect.items() if chosen]
    return Table("One hidden effect", columns, rows)


def _provable(outcomes: list[Outcome]) -> str:
    return share(all(o.provable.values()) for o in outcomes if o.provable)


def _pairs(outcomes: list[Outcome]) -> Table:
    def row(name: str, chosen: list[Outcome]) -> tuple[str, ...]:
        in_class = [[any(effect in entry for entry in named(o)) for effect in o.hidden] for o in chosen]
        by_name = [[any(effect == entry[0] for entry in named(o)) for effect in o.hidden] for o in chosen]
        first = (bool(set(o.hidden) & set([*named(o), []][0])) for o in chosen)
        shares = (map(all, in_class), map(all, by_name), map(any, in_class), first)
        return (name, *map(share, shares), _provable(chosen))

    columns = ("", "both in some class", "both by name", "one or both in some class", "first named is one of them",
               "both provable at best")  # fmt: skip
    rows = [row("all", outcomes), row("both visible", [o for o in outcomes if all(o.visible.values())])]
    return Table("Two hidden effects", columns, rows)


def _controls(outcomes: list[Outcome]) -> Table:
    columns = ("", "missing or unknown physics", "exact called parameters_off", "misset called parameters_off",
               "misset and usable called so", "crashes", "refused")  # fmt: skip

    def row(name: str, chosen: list[Outcome]) -> tuple[str, ...]:
        exact = [o for o in chosen if o.label == "exact"]
        misset = [o for o in chosen if o.label == "misset"]
        groups = (exact, misset, [o for o in misset if usable(o)])
        off = (share(o.verdict == "parameters_off" for o in group) for group in groups)
        ended = (share(o.verdict == what for o in chosen) for what in ("crash", "refused"))
        return (name, share(map(false_alarm, chosen)), *off, *ended)

    clean = [o for o in outcomes if o.fault == "none"]
    rows = [row("all", outcomes), row("clean", clean), row("faulty", [o for o in outcomes if o.fault != "none"])]
    faults = sorted({o.fault for o in outcomes} - {"none"})
    rows += [row(fault, [o for o in outcomes if o.fault == fault]) for fault in faults]
    return Table("Controls: no physics is missing", columns, rows)


def _outside(outcomes: list[Outcome]) -> Table:
    columns = ("", "wrongly named", "unknown or empirical", "fairly named", "no mismatch seen", "crashes")

    def row(name: str, chosen: list[Outcome]) -> tuple[str, ...]:
        empirical = [all(c[0] not in EFFECTS for c in o.classes) for o in chosen]
        flags = (
            map(wrongly_named, chosen),
            (o.verdict in ("unknown_physics", "missing_physics") and e for o, e in zip(chosen, empirical, strict=True)),
            (not e and not wrongly_named(o) for o, e in zip(chosen, empirical, strict=True)),
            (o.verdict in ("no_mismatch", "parameters_off", "not_testable") for o in chosen),
            (o.verdict == "crash" for o in chosen),
        )
        return (name, *map(share, flags))

    labels = sorted({o.label for o in outcomes})
    rows = [row("all", outcomes), *(row(label, [o for o in outcomes if o.label == label]) for label in labels)]
    return Table("Mechanisms outside the catalogue", columns, rows)


def _later(outcomes: list[Outcome]) -> list[Table]:
    drives = [list(drive.values()) for o in outcomes for drive in o.later]
    figures = [tuple(f"{median:.2f}" for median in np.median(drives, axis=0))] if drives else []
    means = [np.mean([list(drive.values()) for drive in o.later], axis=0).tolist() for o in outcomes if o.later]
    files = tuple(share(own > other[index] + 1.0 for *other, own in means) for index in range(3))
    wanted = [
        (effect, ["ageing"] if effect == "ageing" and USABLE_ENERGY in o.off else o.holds)  # a smaller battery
        for o in outcomes
        for effect, seen in o.visible.items()
        if seen and effect not in (*INSTRUMENTS, *NOT_SAID)
    ]
    kept = [
        ("any effect", share(bool(holds) for _, holds in wanted)),
        ("the hidden effect", share(effect in holds for effect, holds in wanted)),
    ]
    by_file = Table(
        "Files whose mean error over later drives is larger by over a point than that of", MODELS[:-1], [files]
    )
    held = Table("Visible effects that a file can say, for which corrected.toml holds", ("", "share"), kept)
    medians = Table("Energy of later drives, median error in %", MODELS, figures)
    return [medians, by_file, held]


def _coverage(outcomes: list[Outcome]) -> Table:
    intervals = [interval for outcome in outcomes for interval in outcome.intervals]
    columns = ("", "covers the truth", "median relative width")

    def row(name: str, chosen: list[Interval]) -> tuple[str, ...]:
        widths = [(i["high"] - i["low"]) / abs(i["true"]) for i in chosen if i["true"] != 0.0]
        held = share(i["low"] <= i["true"] <= i["high"] for i in chosen)
        return name, held, f"{np.median(widths):.3f}" if widths else "–"

    effects, groups = ([i for i in intervals if ("." in i["name"]) == of_effect] for of_effect in (True, False))
    rows = [row("all", intervals), row("parameters of effects", effects), row("groups of the robot", groups)]
    rows.append(row("of these said to be off", [i for i in groups if i["off"]]))
    names = sorted({i["name"] for i in intervals})
    rows += [row(name, [i for i in intervals if i["name"] == name]) for name in names]
    return Table("Intervals of 95 %", columns, rows)
