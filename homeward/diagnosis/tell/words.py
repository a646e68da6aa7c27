"""The sentences of a diagnosis: templates/summary.txt and its values."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY
from homeward.diagnosis.explain.places import condition, largest, total_share
from homeward.diagnosis.fit.channel_errors import Influence, is_autocorrelated, unrecorded
from homeward.diagnosis.fit.estimates import Estimate
from homeward.diagnosis.fit.usable import Finding
from homeward.diagnosis.result import (
    CorrectedFile,
    FileNumber,
    Fit,
    FittedGroup,
    Gauge,
    MissingPhysics,
    Product,
    Value,
    Verdict,
    limit_end,
)
from homeward.layout.notation import interval, number, templates, unit_after

UNLIMITED = "not limited by the recordings"
"""Instead of the interval of a number that may be anything within its bounds."""

_MOST_REASONS = 3  # why runs cannot be used, in one sentence; chosen: it can still be read

PAPER_ACCURACY = "66 to 91 %"
"""Accuracy that the paper claims for the range estimated by its model."""

ARMS: Mapping[str, str] = {
    "nominal": "the robot file as it is",
    "refit": "its parameters fitted",
    "corrected": "fitted together with what was found missing",
    "file": "corrected.toml, replayed as written",
    "black_box": "boosted trees on the same channels: an upper bound of the gain",
    "placebo": "what was found missing, shifted in time: the gain by chance",
}
"""The arms of the comparison in the order in which they are shown, in words."""


def nothing_usable(findings: Sequence[Finding]) -> str:
    """Why no run can be used."""
    refused = [finding for finding in findings if finding.refused]
    reasons = "; ".join(
        f"{PurePath(finding.recording).name} {finding.text}" for finding in refused[:_MOST_REASONS]
    )
    if len(refused) > _MOST_REASONS:
        reasons = f"{reasons}; and {len(refused) - _MOST_REASONS} more"
    return _ended(f"None of the recordings can be used: {reasons}")


def _ended(sentence: str) -> str:
    """A sentence with its full stop, but for a question."""
    return sentence if sentence.endswith("?") else f"{sentence}."


def summary(
    verdict: Verdict,
    evidence: Evidence,
    off: Sequence[FittedGroup],
    fit: Fit,
    findings: Sequence[Finding],
    missing: Sequence[MissingPhysics],
    file: CorrectedFile,
    gauge: Gauge | None = None,
) -> str:
    """The verdict in one or two sentences, the content of corrected.toml, and how many runs were
    excluded."""
    template = templates("homeward.diagnosis.tell", autoescape=False).get_template("summary.txt")
    text = template.render(
        verdict=verdict,
        evidence=evidence,
        off=off,
        fit=fit,
        missing=missing,
        file=file,
        condition=condition,
        why_open=why_open,
        place=_place(evidence),
        excess=_excess(evidence),
        shares=[total_share(added, evidence.runs) for added in evidence.contributions],
        refused=[finding for finding in findings if finding.refused],
        unrecorded=_unrecorded(evidence, fit),
        usable_energy=USABLE_ENERGY,
        thresholds=thresholds,
        of_gauge=_of_gauge(gauge),
        limited=_limited(missing, evidence.products),
    )
    # The template breaks its lines where its readers want them.
    return " ".join(text.split())


def _of_gauge(gauge: Gauge | None) -> list[str]:
    """Why a gauge is not believed, and what is asked about its battery, as sentences; nothing of a
    plain counter."""
    sentences = []
    if gauge is not None and gauge.follows != "charge" and gauge.says:
        sentences.append(gauge.says)
    if gauge is not None and gauge.question:
        sentences.append(gauge.question)
    return [_ended(f"{sentence[0].upper()}{sentence[1:]}") for sentence in sentences]


def _unrecorded(evidence: Evidence, fit: Fit) -> list[Influence]:
    """Unrecorded dependencies of power, where the best model has a large autocorrelated residual;
    else none."""
    runs = evidence.runs
    arm = "corrected" if "corrected" in fit.arms else "refit"
    r2 = fit.arms[arm].r2
    if r2 is None:
        return []
    if evidence.naming.unrecorded:
        return unrecorded(runs)
    if r2 <= thresholds.NEARLY_ALL and is_autocorrelated(
        runs.observed - evidence.predictions[arm], runs
    ):
        return unrecorded(runs)
    return []


def _excess(evidence: Evidence) -> float | None:
    """Mean residual of the effects, or held-out error of the refit over that elsewhere, under the
    located condition."""
    if evidence.remaining is not None:
        location = evidence.remaining.location
        return float(location.excess[location.inside].mean())
    if evidence.location is None or not evidence.location.inside.any():
        return None
    inside = evidence.location.inside
    error = evidence.runs.observed - evidence.predictions["refit"]
    elsewhere = 0.0
    if not inside.all():
        elsewhere = float(error[~inside].mean())
    return float(error[inside].mean()) - elsewhere


def _place(evidence: Evidence) -> str:
    """The located condition; for changes in time, the stretch that holds most of the excess."""
    location = evidence.location
    if location is None:
        return ""
    if all(place.condition == location.condition for place in location.places):
        return location.condition
    return largest(location.places)


def spanned(value: Value | FileNumber) -> str:
    """The interval of a value or, where it is limited from one side only, its limit; or that
    nothing limits it."""
    if value.ci95 is None:
        return UNLIMITED
    if value.limit is None:
        return interval(value.ci95)
    return f"{value.limit} {number(limit_end(value))}"


def _limited(missing: Sequence[MissingPhysics], products: Sequence[Product]) -> list[str]:
    """What is known of parameters that are limited from one side, a sentence each."""
    sentences = []
    for effect in missing:
        for parameter, value in effect.parameters.items():
            if value.limit is None:
                continue
            name = f"{effect.effect} {parameter}"
            known = [_stated(product) for product in products if name in product.of]
            sentence = f"The {name} is {spanned(value)}{unit_after(value.unit)}"
            if known:
                sentence = f"{sentence}, as only {' and '.join(known)} is known"
            sentences.append(f"{sentence}.")
    return sentences


def _stated(product: Product) -> str:
    """A product with its value and interval."""
    value = product.value
    size = number(value.value) + unit_after(value.unit)
    return f"{product.name} = {size} (95 %: {interval(value.ci95)})"


def why_open(estimate: Estimate) -> str:
    """Why a group has no value, in a phrase."""
    phrases = {
        "fitted": "fitted",
        "not excited": "has no influence on these recordings",
        "confounded": f"is confounded with {', '.join(estimate.mixed_with)}",
        "too uncertain": "its interval is too wide",
        "attenuated": "errors of its channel make it too small",
        "at bound": "fitted at its physical bound, so not a measurement",
    }
    return phrases[estimate.status]
