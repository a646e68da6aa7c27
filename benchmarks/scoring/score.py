"""How often the tool was right: rates with intervals over all cases, the confusion matrix, and why cases failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from scipy.stats import binomtest

from benchmarks.plants.case import Noise
from benchmarks.scoring.outcome import CRASHED, UNNAMED, Outcome

NOISES: tuple[Noise, ...] = ("low", "middle", "high")
CONTROLS = ("exact", "misset")


@dataclass(frozen=True)
class Rate:
    """Hits among cases."""

    hits: int
    of: int

    @property
    def share(self) -> float | None:
        """Share of hits; None without cases."""
        return self.hits / self.of if self.of else None

    @property
    def ci95(self) -> tuple[float, float] | None:
        """Wilson's interval of the share."""
        if not self.of:
            return None
        interval = binomtest(self.hits, self.of).proportion_ci(method="wilson")
        return float(interval.low), float(interval.high)

    def __str__(self) -> str:
        if self.share is None or self.ci95 is None:
            return "-"
        low, high = self.ci95
        return f"{self.share:.0%} ({self.hits}/{self.of}; {100 * low:.0f} to {100 * high:.0f})"


@dataclass(frozen=True)
class Headline:
    """A figure that a target is set for: a rate, or the median of `median_of`."""

    what: str
    rate: Rate
    target: float | None = None
    at_most: bool = False
    middle: float | None = None

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None where there is none or nothing to measure."""
        value = self.rate.share if self.middle is None else self.middle
        if self.target is None or value is None:
            return None
        return value <= self.target if self.at_most else value >= self.target


@dataclass(frozen=True)
class Row:
    """Single cases of one effect at one noise level."""

    effect: str
    noise: str
    first: Rate
    in_class: Rate
    class_size: float | None  # mean, of those that name something
    anywhere: Rate
    f1: float
    error_fell: Rate


@dataclass(frozen=True)
class Failure:
    """A case in which the tool was wrong, and what is known about why."""

    name: str
    source: str
    kind: str
    truth: str
    noise: str
    verdict: str
    named: str
    reason: str
    absorbed: str
    alone: str  # how the hidden effect did as a hypothesis alone


def rate(outcomes: Iterable[Outcome], hit: Callable[[Outcome], object]) -> Rate:
    """Share of the cases that are a hit."""
    every = [bool(hit(one)) for one in outcomes]
    return Rate(sum(every), len(every))


def of_kind(outcomes: Iterable[Outcome], *kinds: str) -> list[Outcome]:
    """Cases of these kinds."""
    return [one for one in outcomes if one.truth.kind in kinds]


def headlines(outcomes: Sequence[Outcome]) -> list[Headline]:
    """The figures that are asked for, each with its target; those for which there is no case are left out."""
    singles, pairs, outside = (of_kind(outcomes, kind) for kind in ("single", "pair", "outside"))
    controls, effects = of_kind(outcomes, *CONTROLS), of_kind(outcomes, "single", "pair")
    targets: dict[str, float | None] = {"low": 0.9, "middle": None, "high": 0.8}
    found = [
        Headline(f"singles, {noise} noise: true effect, or class that holds it, first",
                 rate([one for one in singles if one.truth.noise == noise], lambda one: one.class_is_true), target)
        for noise, target in targets.items()
    ]  # fmt: skip
    found += [
        Headline("singles: true effect itself first", rate(singles, lambda one: one.first_is_true)),
        Headline("pairs: both found", rate(pairs, lambda one: one.both_found), 0.7),
        Headline("pairs: both in some class", rate(pairs, lambda one: one.both_mentioned)),
        Headline("controls called missing_physics", rate(controls, _is("missing_physics")), 0.05, at_most=True),
    ]
    for kind in CONTROLS:
        every = of_kind(controls, kind)
        found += [
            Headline(f"{kind} controls called {verdict}", rate(every, _is(verdict)), target, at_most=True)
            for verdict, target in (("missing_physics", 0.05), ("unknown_physics", None), ("parameters_off", None))
        ]
    found += [
        Headline(
            "outside the catalogue: unknown_physics or an empirical term", rate(outside, lambda one: one.is_right)
        ),
        Headline("outside the catalogue: wrongly named", rate(outside, _wrongly_named)),
        Headline("invisible: right answer", rate(of_kind(outcomes, "invisible"), lambda one: one.is_right)),
        located("singles and pairs", effects),
        located("outside the catalogue", outside),
        Headline("singles and pairs: excess error halved or at the noise", rate(effects, lambda one: one.error_fell)),
        Headline("crashed", rate(outcomes, _is(CRASHED)), 0.0, at_most=True),
    ]
    return [one for one in found if one.rate.of]


def located(what: str, outcomes: Sequence[Outcome]) -> Headline:
    """Share of cases whose located time overlaps the truth with an F1 of 0.8 or more, and the median F1."""
    every = f1(outcomes)
    middle = median(every) if every else None
    return Headline(
        f"{what}: located with F1 of 0.8 or more", Rate(sum(f >= 0.8 for f in every), len(every)), 0.8, middle=middle
    )


def f1(outcomes: Iterable[Outcome]) -> list[float]:
    """Overlap of located and true time of each case in which something is hidden."""
    return [one.location_f1 for one in outcomes if one.location_f1 is not None]


def _is(verdict: str) -> Callable[[Outcome], bool]:
    return lambda one: one.verdict == verdict


def _wrongly_named(one: Outcome) -> bool:
    return bool(one.names) and not one.named_outside_catalogue


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Single cases by effect and noise level."""
    singles = of_kind(outcomes, "single")
    groups: dict[tuple[str, int], list[Outcome]] = {}
    for one in singles:
        groups.setdefault((one.truth.truth[0], NOISES.index(one.truth.noise)), []).append(one)
    return [
        Row(
            effect,
            NOISES[noise],
            rate(group, lambda one: one.first_is_true),
            rate(group, lambda one: one.class_is_true),
            class_size(group),
            rate(group, lambda one: one.is_named_anywhere),
            median(f1(group)),
            rate(group, lambda one: one.error_fell),
        )
        for (effect, noise), group in sorted(groups.items())
    ]


def class_size(outcomes: Iterable[Outcome]) -> float | None:
    """Mean number of effects that the first named stands for, where something is named; a large class says little."""
    sizes = [len(one.classes[0]) for one in outcomes if one.classes]
    return sum(sizes) / len(sizes) if sizes else None


def confusion(outcomes: Iterable[Outcome]) -> dict[str, dict[str, int]]:
    """Hidden effect of single cases, or kind of the others without pairs, against what was named first."""
    counts: dict[str, Counter[str]] = {}
    for one in of_kind(outcomes, "single", "outside", *CONTROLS):
        row = one.truth.truth[0] if one.truth.kind == "single" else one.truth.kind
        counts.setdefault(row, Counter())[one.first] += 1
    order = sorted(counts, key=lambda row: (row in ("outside", *CONTROLS), row))
    return {row: dict(counts[row].most_common()) for row in order}


def failures(outcomes: Iterable[Outcome]) -> list[Failure]:
    """Cases in which the tool was wrong, those with the most frequent reason first."""
    found = [_failure(one) for one in outcomes if not one.is_right]
    often = Counter((one.kind, one.reason) for one in found)
    return sorted(found, key=lambda one: (-often[one.kind, one.reason], one.kind, one.reason, one.truth, one.noise))


def _failure(one: Outcome) -> Failure:
    named = [
        f"{effect} [{', '.join(sorted(held - {effect}))}]" if len(held) > 1 else effect
        for effect, held in zip(one.names, one.classes, strict=True)
    ]
    return Failure(
        one.truth.name, one.truth.source, one.truth.kind, " + ".join(one.truth.truth) or "nothing", one.truth.noise,
        one.verdict, "; ".join(named) or "-", reason(one),
        " ".join("null" if share is None else f"{share:.2f}" for share in one.absorbed) or "-",
        "; ".join(_alone(one, effect) for effect in one.truth.truth) or _evidence(one),
    )  # fmt: skip


def _evidence(one: Outcome) -> str:
    """What speaks for the first effect named in a control."""
    if one.diagnosis is None or not one.diagnosis.missing_physics:
        return "-"
    evidence = one.diagnosis.missing_physics[0].evidence
    gain = "?" if evidence.held_out_gain is None else f"{evidence.held_out_gain:.3f}"
    return f"dBIC {evidence.delta_bic or 0.0:.0f}, gain {gain}"


def _alone(one: Outcome, effect: str) -> str:
    alone = one.alone(effect)
    if alone is None:
        return "not tried"
    best = one.aside.ranking[0]
    return f"dBIC {alone.delta_bic:.0f} (best {best.delta_bic:.0f}), gain {alone.held_out_gain:.3f}"


def reason(one: Outcome) -> str:
    """Why a case failed, in a few words that cases share."""
    if one.verdict == CRASHED:
        return f"crashed: {one.aside.error}"
    if one.truth.kind in CONTROLS or one.truth.kind == "outside":
        return f"named {one.first}" if one.names else f"nothing named, {one.verdict}"
    if one.truth.kind == "pair" and one.names:
        found = [effect for effect in one.truth.truth if any(effect in held for held in one.classes)]
        return "one effect stands for both" if len(found) == 2 else f"only {found[0]} found" if found else "none found"
    if one.names:
        second = any(not held.isdisjoint(one.truth.truth) for held in one.classes[1:])
        return f"{one.first} first" + (", the true one after it" if second else _not_tried(one))
    return f"nothing named, {one.verdict}{_not_tried(one)}"


def _not_tried(one: Outcome) -> str:
    return "" if all(one.alone(effect) for effect in one.truth.truth) else ", the true one not tried"


def columns(matrix: dict[str, dict[str, int]]) -> list[str]:
    """Columns of the confusion matrix: hidden effects in the order of the rows, others that were named, verdicts."""
    named = {column for row in matrix.values() for column in row}
    effects = [row for row in matrix if row not in ("outside", *CONTROLS)]
    return [*effects, *sorted(named - set(effects) - set(UNNAMED)), *(one for one in UNNAMED if one in named)]
