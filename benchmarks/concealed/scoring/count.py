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
    hits = sum(listed)
    total = len(listed)
    low, high = wilson(hits, total)
    return f"{hits}/{total} = {100 * hits / total:.0f} % ({100 * low:.0f}–{100 * high:.0f})"


@dataclass(frozen=True)
class Table:
    """A title, the names of the columns, and rows of text."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]

    def markdown(self) -> str:
        """The table in Markdown."""
        rule = "|" + "---|" * len(self.columns)
        lines = [f"### {self.title}", "", _line(self.columns), rule]
        lines += [_line(row) for row in self.rows]
        return "\n".join([*lines, ""])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def named(outcome: Outcome) -> list[list[str]]:
    """Named classes; a capacity that is too small in all drives counts as ageing or one of its
    stated alternatives."""
    if not outcome.capacity:
        return outcome.classes
    return [*outcome.classes, outcome.capacity]


def first_class(outcome: Outcome) -> list[str]:
    """The first named class, [] if nothing is named."""
    classes = named(outcome)
    return classes[0] if classes else []


def found_first(outcome: Outcome) -> bool:
    """Whether the concealed effect is the first named one, or one that it is stated to be confused
    with."""
    return outcome.hidden[0] in first_class(outcome)


def is_mismatch_missed(outcome: Outcome) -> bool:
    """Whether the diagnosis sees no more than other values of the parameters."""
    return outcome.verdict in ("no_mismatch", "parameters_off", "not_testable")


def all_visible(outcome: Outcome) -> bool:
    """Whether every concealed effect is visible in the recordings."""
    return all(outcome.visible.values())


def usable(outcome: Outcome) -> bool:
    """Whether a control's recordings identify its parameters: not with power of the wrong sign or
    unrecorded hills."""
    return outcome.fault not in ("wrong_sign", "no_grade")


def false_alarm(outcome: Outcome) -> bool:
    """Whether the diagnosis of a control names physics; without a grade channel it may ask for that
    channel."""
    if outcome.verdict == "unknown_physics" and outcome.fault == "no_grade":
        return not NAMES_GRADE.search(outcome.summary)
    return outcome.verdict in ("missing_physics", "unknown_physics")


def wrongly_named(outcome: Outcome) -> bool:
    """Whether a mechanism outside the catalogue was named as an effect that is no acceptable
    description of it."""
    return any(
        effects[0] in EFFECTS and set(outcome.fair).isdisjoint(effects)
        for effects in outcome.classes
    )


def names_no_effect(outcome: Outcome) -> bool:
    """Whether no effect of the catalogue is named; a formula may be."""
    return all(effects[0] not in EFFECTS for effects in outcome.classes)


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """All tables with outcomes."""
    made: list[Table] = []
    made += _by_kind([outcome for outcome in outcomes if outcome.part not in NEEDS])
    for part in NEEDS:  # of another simulator
        for table in _by_kind([outcome for outcome in outcomes if outcome.part == part]):
            made.append(dataclasses.replace(table, title=f"{table.title}, {part}"))
    hidden = [outcome for outcome in outcomes if outcome.part in ("singles", "pairs")]
    if hidden:
        made += _later(hidden)
    return made


def _by_kind(outcomes: Sequence[Outcome]) -> list[Table]:
    """A table for each kind of cases that there is."""
    makers: dict[str, Callable[[list[Outcome]], Table]] = {
        "singles": _singles, "pairs": _pairs, "controls": _controls, "outside": _outside, "coverage": _coverage,
    }  # fmt: skip
    made = []
    for kind, maker in makers.items():
        of_kind = [outcome for outcome in outcomes if outcome.kind == kind]
        if of_kind:
            made.append(maker(of_kind))
    return made


def _singles(outcomes: list[Outcome]) -> Table:
    columns = ("", "found first", "of these visible", *NOISES, "provable at best", "first by name",
               "visible but no mismatch", "class size")  # fmt: skip

    def row(name: str, cases: list[Outcome]) -> tuple[str, ...]:
        visible = [case for case in cases if all_visible(case)]
        by_noise = [
            share(found_first(case) for case in cases if case.label == noise) for noise in NOISES
        ]
        by_name = share(
            bool(case.classes) and case.classes[0][0] == case.hidden[0] for case in cases
        )
        sizes = [len(case.classes[0]) for case in cases if case.classes]
        return (
            name,
            share(map(found_first, cases)),
            share(map(found_first, visible)),
            *by_noise,
            _provable(cases),
            by_name,
            share(map(is_mismatch_missed, visible)),
            f"{np.mean(sizes):.2f}" if sizes else "–",
        )

    of_physics = [case for case in outcomes if case.hidden[0] not in INSTRUMENTS]
    of_instruments = [case for case in outcomes if case.hidden[0] in INSTRUMENTS]
    rows = [row("all", outcomes), row("physics", of_physics), row("instruments", of_instruments)]
    for effect in EFFECTS:
        of_effect = [case for case in outcomes if case.hidden[0] == effect]
        if of_effect:
            rows.append(row(effect, of_effect))
    return Table("One hidden effect", columns, rows)


def _provable(outcomes: list[Outcome]) -> str:
    return share(all(case.provable.values()) for case in outcomes if case.provable)


def _pairs(outcomes: list[Outcome]) -> Table:
    def row(name: str, cases: list[Outcome]) -> tuple[str, ...]:
        in_class = [[in_some_class(case, effect) for effect in case.hidden] for case in cases]
        by_name = [[named_itself(case, effect) for effect in case.hidden] for case in cases]
        return (
            name,
            share(map(all, in_class)),
            share(map(all, by_name)),
            share(map(any, in_class)),
            share(not set(first_class(case)).isdisjoint(case.hidden) for case in cases),
            _provable(cases),
        )

    columns = ("", "both in some class", "both by name", "one or both in some class", "first named is one of them",
               "both provable at best")  # fmt: skip
    rows = [
        row("all", outcomes),
        row("both visible", [case for case in outcomes if all_visible(case)]),
    ]
    return Table("Two hidden effects", columns, rows)


def in_some_class(case: Outcome, effect: str) -> bool:
    """Whether the diagnosis names the effect, or a class that it is in."""
    return any(effect in effects for effects in named(case))


def named_itself(case: Outcome, effect: str) -> bool:
    """Whether the diagnosis names the effect, and not only one that it is confused with."""
    return any(effect == effects[0] for effects in named(case))


def _controls(outcomes: list[Outcome]) -> Table:
    columns = ("", "missing or unknown physics", "exact called parameters_off", "misset called parameters_off",
               "misset and usable called so", "crashes", "refused")  # fmt: skip

    def row(name: str, cases: list[Outcome]) -> tuple[str, ...]:
        exact = [case for case in cases if case.label == "exact"]
        misset = [case for case in cases if case.label == "misset"]
        return (
            name,
            share(map(false_alarm, cases)),
            _share_with(exact, "parameters_off"),
            _share_with(misset, "parameters_off"),
            _share_with(filter(usable, misset), "parameters_off"),
            _share_with(cases, "crash"),
            _share_with(cases, "refused"),
        )

    by_fault: dict[str, list[Outcome]] = {}
    for case in outcomes:
        by_fault.setdefault(case.fault, []).append(case)
    clean = by_fault.pop("none", [])
    faulty = [case for case in outcomes if case.fault != "none"]
    rows = [row("all", outcomes), row("clean", clean), row("faulty", faulty)]
    rows += [row(fault, by_fault[fault]) for fault in sorted(by_fault)]
    return Table("Controls: no physics is missing", columns, rows)


def _share_with(outcomes: Iterable[Outcome], verdict: str) -> str:
    return share(case.verdict == verdict for case in outcomes)


def _outside(outcomes: list[Outcome]) -> Table:
    columns = (
        "",
        "wrongly named",
        "unknown or empirical",
        "fairly named",
        "no mismatch seen",
        "crashes",
    )

    def is_unknown(case: Outcome) -> bool:
        return case.verdict in ("unknown_physics", "missing_physics") and names_no_effect(case)

    def is_fair(case: Outcome) -> bool:
        return not names_no_effect(case) and not wrongly_named(case)

    def row(name: str, cases: list[Outcome]) -> tuple[str, ...]:
        return (
            name,
            share(map(wrongly_named, cases)),
            share(map(is_unknown, cases)),
            share(map(is_fair, cases)),
            share(map(is_mismatch_missed, cases)),
            _share_with(cases, "crash"),
        )

    rows = [row("all", outcomes)]
    for label in sorted({case.label for case in outcomes}):
        rows.append(row(label, [case for case in outcomes if case.label == label]))
    return Table("Mechanisms outside the catalogue", columns, rows)


def _later(outcomes: list[Outcome]) -> list[Table]:
    """Tables of the errors over later drives, and of the effects that files hold."""
    drives = [list(drive.values()) for case in outcomes for drive in case.later]
    medians = [tuple(f"{median:.2f}" for median in np.median(drives, axis=0))] if drives else []
    mean_pct = [mean_errors_pct(case) for case in outcomes if case.later]
    is_worse = [
        [mean[-1] > mean[model] + 1.0 for mean in mean_pct] for model in range(len(MODELS) - 1)
    ]
    return [
        Table("Energy of later drives, median error in %", MODELS, medians),
        Table(
            "Files whose mean error over later drives is larger by over a point than that of",
            MODELS[:-1],
            [tuple(map(share, is_worse))],
        ),
        _effects_in_files(outcomes),
    ]


def mean_errors_pct(case: Outcome) -> list[float]:
    """Mean error over the later drives of a case by each of `MODELS`, %."""
    by_drive = [list(drive.values()) for drive in case.later]
    return [float(mean) for mean in np.mean(by_drive, axis=0)]


def _effects_in_files(outcomes: list[Outcome]) -> Table:
    holds_any = []
    holds_hidden = []
    for case in outcomes:
        for effect, is_visible in case.visible.items():
            if not is_visible or effect in (*INSTRUMENTS, *NOT_SAID):
                continue
            has_smaller_battery = effect == "ageing" and USABLE_ENERGY in case.off
            holds_any.append(has_smaller_battery or bool(case.holds))
            holds_hidden.append(has_smaller_battery or effect in case.holds)
    rows = [("any effect", share(holds_any)), ("the hidden effect", share(holds_hidden))]
    return Table(
        "Visible effects that a file can say, for which corrected.toml holds", ("", "share"), rows
    )


def _coverage(outcomes: list[Outcome]) -> Table:
    intervals = [interval for outcome in outcomes for interval in outcome.intervals]
    columns = ("", "covers the truth", "median relative width")

    def row(name: str, selected: list[Interval]) -> tuple[str, ...]:
        covers = share(
            interval["low"] <= interval["true"] <= interval["high"] for interval in selected
        )
        nonzero = [interval for interval in selected if interval["true"] != 0.0]
        widths = [
            (interval["high"] - interval["low"]) / abs(interval["true"]) for interval in nonzero
        ]
        return name, covers, f"{np.median(widths):.3f}" if widths else "–"

    by_name: dict[str, list[Interval]] = {}
    for interval in intervals:
        by_name.setdefault(interval["name"], []).append(interval)
    of_effects = [interval for interval in intervals if "." in interval["name"]]
    of_robot = [interval for interval in intervals if "." not in interval["name"]]
    said_off = [interval for interval in of_robot if interval["off"]]
    rows = [
        row("all", intervals),
        row("parameters of effects", of_effects),
        row("groups of the robot", of_robot),
    ]
    rows.append(row("of these said to be off", said_off))
    rows += [row(name, by_name[name]) for name in sorted(by_name)]
    return Table("Intervals of 95 %", columns, rows)
