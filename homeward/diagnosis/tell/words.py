"""The sentences of a diagnosis: templates/summary.txt and its values."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY
from homeward.diagnosis.explain.places import condition, largest, total_share
from homeward.diagnosis.fit.channel_errors import Influence, is_autocorrelated, unrecorded
from homeward.diagnosis.fit.refit import Estimate
from homeward.diagnosis.fit.usable import Finding
from homeward.diagnosis.result import CorrectedFile, Fit, FittedGroup, Gauge, MissingPhysics, Verdict
from homeward.layout.notation import templates

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
    refused = [one for one in findings if one.refused]
    reasons = "; ".join(f"{PurePath(one.recording).name} {one.text}" for one in refused[:3])
    more = f"; and {len(refused) - 3} more" if len(refused) > 3 else ""
    return f"None of the recordings can be used: {reasons}{more}{'' if (reasons + more).endswith('?') else '.'}"


def summary(
    verdict: Verdict,
    evidence: Evidence,
    off: Sequence[FittedGroup],
    fit: Fit,
    findings: Sequence[Finding],
    found: Sequence[MissingPhysics],
    file: CorrectedFile,
    gauge: Gauge | None = None,
) -> str:
    """The verdict in one or two sentences, the content of corrected.toml, and how many runs were excluded."""
    text = templates("homeward.diagnosis.tell", autoescape=False).get_template("summary.txt").render(
        verdict=verdict, evidence=evidence, off=off, fit=fit, found=found, file=file, condition=condition,
        why_open=why_open, place=_place(evidence), excess=_excess(evidence),
        shares=[total_share(added, evidence.runs) for added in evidence.contributions],
        refused=[one for one in findings if one.refused], unrecorded=_unrecorded(evidence, fit),
        usable_energy=USABLE_ENERGY, thresholds=thresholds, of_gauge=_of_gauge(gauge),
    )  # fmt: skip
    return " ".join(text.split())


def _of_gauge(gauge: Gauge | None) -> list[str]:
    """Why a gauge is not believed, and what is asked about its battery, as sentences; nothing of a plain counter."""
    if gauge is None:
        return []
    lines = [gauge.says if gauge.follows != "charge" else None, gauge.question]
    return [f"{line[0].upper()}{line[1:].rstrip('?')}{'?' if line.endswith('?') else '.'}" for line in lines if line]


def _unrecorded(evidence: Evidence, fit: Fit) -> list[Influence]:
    """Unrecorded dependencies of power, where the best model has a large autocorrelated residual; else none."""
    best = "corrected" if "corrected" in fit.arms else "refit"
    r2, runs, lacks = fit.arms[best].r2, evidence.runs, evidence.naming.unrecorded
    if r2 is None or (r2 > thresholds.NEARLY_ALL and not lacks):
        return []
    return unrecorded(runs) if lacks or is_autocorrelated(runs.observed - evidence.predictions[best], runs) else []


def _excess(evidence: Evidence) -> float | None:
    """Mean residual of the effects, or held-out error of the refit over that elsewhere, under the located condition."""
    if evidence.remaining is not None:
        return float(evidence.remaining.location.excess[evidence.remaining.location.inside].mean())
    if evidence.location is None or not evidence.location.inside.any():
        return None
    inside, error = evidence.location.inside, evidence.runs.observed - evidence.predictions["refit"]
    return float(error[inside].mean()) - (float(error[~inside].mean()) if (~inside).any() else 0.0)


def _place(evidence: Evidence) -> str:
    """The located condition; for changes in time, the stretch that holds most of the excess."""
    location = evidence.location
    if location is None or all(place.condition == location.condition for place in location.places):
        return "" if location is None else location.condition
    return largest(location.places)


def why_open(estimate: Estimate) -> str:
    """Why a group has no value, in a phrase."""
    mixed = estimate.mixed_with
    return {
        "fitted": "fitted",
        "not excited": "has no influence on these recordings",
        "confounded": f"is confounded with {', '.join(mixed)}",
        "too uncertain": "its interval is too wide",
        "at bound": "fitted at its physical bound, so not a measurement",
    }[estimate.status]
