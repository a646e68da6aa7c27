"""The sentences of a diagnosis, as a roboticist would say them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING

from homeward.diagnosis.explain.describe import condition, total_share
from homeward.diagnosis.explain.places import WHOLE_RUN, Location
from homeward.diagnosis.explain.witnesses import USABLE_ENERGY
from homeward.diagnosis.fit.refit import Estimate
from homeward.diagnosis.fit.usable import Finding
from homeward.diagnosis.result import Fit, Handed, MissingPhysics, ParameterOff, Verdict
from homeward.diagnosis.rules import EXPLAINS, FALSE_ALARM_RATE, FEWEST_BLOCKS, LASTS

if TYPE_CHECKING:
    from homeward.diagnosis.evidence import Evidence

_HOLDS = {
    "corrected": "holds it",
    "refit": "holds the fitted parameters only",
    "nominal": "keeps the robot as it was",
}
_MEASURED = {"W": "battery power", "A": "motor current"}


def nothing_usable(findings: Sequence[Finding]) -> str:
    """Why no run can be used."""
    refused = [one for one in findings if one.refused]
    reasons = "; ".join(f"{PurePath(one.recording).name} {one.text}" for one in refused[:3])
    more = f"; and {len(refused) - 3} more" if len(refused) > 3 else ""
    return f"None of the recordings can be used: {reasons}{more}{'' if (reasons + more).endswith('?') else '.'}"


def summary(
    verdict: Verdict,
    evidence: Evidence,
    off: Sequence[ParameterOff],
    fit: Fit,
    findings: Sequence[Finding],
    found: Sequence[MissingPhysics],
    handed: Handed,
) -> str:
    """The verdict in one or two sentences, what corrected.toml holds, and how many runs were set aside."""
    first = (
        _missing_physics(evidence, fit, found)
        if verdict == "missing_physics"
        else {
            "not_testable": _not_testable,
            "unknown_physics": _unknown_physics,
            "parameters_off": _parameters_off,
            "no_mismatch": _no_mismatch,
        }[verdict](evidence, off, fit)
    )
    if verdict in ("parameters_off", "missing_physics"):
        first += f" corrected.toml {_HOLDS[handed.holds]}: {handed.why}."
    first += _not_recorded(evidence, fit)
    refused = [one for one in findings if one.refused]
    if refused:
        names = PurePath(refused[0].recording).name
        first += (
            f" {len(refused)} of the runs set aside ({names} {refused[0].text}{', ...' if len(refused) > 1 else ''})."
        )
    return first


_TELLS = (
    ("slopes", ("grade_rad",), "grade_rad or elevation_m"),
    ("turns", ("yaw_rate_radps", "wheel_difference_mps"), "yaw_rate_radps"),
    ("the sensing rate", ("sensing_hz",), "sensing_hz"),
)
"""What power follows beside speed, the channels that tell it, and what to record."""


def _not_recorded(evidence: Evidence, fit: Fit) -> str:
    """What was not recorded, where the best model leaves much that lasts; nothing where all was."""
    best, model = fit.arms.get("corrected", fit.arms["refit"]), evidence.predictions.get("corrected", evidence.refit)
    missing = [one for one in _TELLS if not any(name in evidence.runs.context for name in one[1])]
    if fit.unit == "A":
        missing = [one for one in missing if one[0] != "the sensing rate"]
    if not missing or best.r2 is None or (best.r2 > EXPLAINS and not evidence.naming.unrecorded):
        return ""
    left = evidence.runs.observed - model
    together = evidence.runs.run[1:] == evidence.runs.run[:-1]
    lasts = float((left[1:] * left[:-1])[together].sum()) >= LASTS * float(left @ left)
    if not (lasts or evidence.naming.unrecorded):
        return ""
    what, record = " and ".join(one[0] for one in missing), " and ".join(one[2] for one in missing)
    return (
        f" Held out, the best fit explains {max(best.r2, 0.0):.0%} of the variance: {what} that were not recorded "
        f"({record}) may be why."
    )


def _not_testable(evidence: Evidence, off: Sequence[ParameterOff], fit: Fit) -> str:
    blocks = int(evidence.block.max()) + 1
    if blocks < FEWEST_BLOCKS:
        return (
            f"These recordings are too short to test anything: they hold {blocks} independent stretches "
            f"and {FEWEST_BLOCKS} are needed."
        )
    reasons = "; ".join(f"{one.group.symbol}: {why_open(one)}" for one in evidence.estimates)
    return f"These recordings determine none of the model's parameters ({reasons}); vary speed, grade and sensing rate."


def _missing_physics(evidence: Evidence, fit: Fit, found: Sequence[MissingPhysics]) -> str:
    told = []
    for one, added in zip(found, evidence.contributions, strict=True):
        share = total_share(added, evidence.runs)
        rivals = f" (or {', '.join(one.confused_with)}: these recordings cannot tell)" if one.confused_with else ""
        what = "energy" if fit.unit == "W" else "charge"
        told.append(f"{one.name}{rivals}, {condition(one.where)}, {share:.0%} of the recorded {what}")
    plain = " ".join(one.sentence for one in found)
    proof = ""
    if "corrected" in fit.arms:
        before, after = fit.arms["refit"].rmse, fit.arms["corrected"].rmse
        proof = f" Held out, the error falls from {before:.3g} (refit) to {after:.3g} {fit.unit}."
    proof += "".join(f" {one.told}" for one in evidence.witnessed)
    proof += _remains(evidence, fit)
    return (
        f"{'What the simulator lacks' if len(told) == 1 else 'The simulator lacks'}: {'; '.join(told)}. {plain}{proof}"
    )


def _remains(evidence: Evidence, fit: Fit) -> str:
    """What the named effects leave, where that still depends on a channel."""
    left = evidence.remains
    if left is None:
        return ""
    excess = left.location.excess[left.location.inside]
    sign = "more" if float(excess.mean()) > 0.0 else "less"
    text = (
        f" Something is left that no known effect explains: {left.location.condition}, the robot draws "
        f"{abs(float(excess.mean())):.2g} {fit.unit} {sign} than the corrected model says, against the rest."
    )
    if left.formula is not None:
        text += (
            f" It follows {left.formula.text}, a description, not a cause, which would take "
            f"{left.formula.held_out_gain:.0%} of the squared error that remains."
        )
    return text


def _unknown_physics(evidence: Evidence, off: Sequence[ParameterOff], fit: Fit) -> str:
    if evidence.location is None:
        stuck = ", ".join(one.group.symbol for one in evidence.estimates if one.status == "at bound")
        return (
            f"The robot file does not explain the recorded {_MEASURED[fit.unit]}, and the best refit ends at the bound "
            f"of what is physical ({stuck}): something is missing that no recorded channel points to."
        )
    measured, refitted = _MEASURED[fit.unit], fit.arms["refit"]
    r2 = "" if refitted.r2 is None else f" (held-out R^2 {round(refitted.r2, 2) + 0.0:.2f})"
    inside = evidence.location.inside
    error = evidence.runs.observed - evidence.refit
    drift = float(error[inside].mean() - error[~inside].mean()) if (~inside).any() else float(error[inside].mean())
    return (
        f"Even with its parameters refitted the model does not explain the recorded {measured}{r2}: "
        f"{_condition(evidence.location)}, the robot draws {abs(drift):.2g} {fit.unit} "
        f"{'more' if drift > 0 else 'less'} than elsewhere beyond what the model says, "
        f"{evidence.location.share:.0%} of the unexplained excess. {_formula(evidence, fit)}"
    )


def _formula(evidence: Evidence, fit: Fit) -> str:
    """The empirical term, or that there is none."""
    found = evidence.empirical
    if found is None:
        return "No known effect explains it, nor does any simple formula of the recorded channels."
    symbols = f" ({', '.join(found.constants.values())})" if found.constants else ""
    intervals = " and ".join(f"{low:.3g} to {high:.3g}" for low, high in (one.ci95 for one in found.terms))
    others = [text for one in found.terms for text in one.alternatives]
    also = f" Here {' or '.join(others)} would do as well." if others else ""
    return (
        f"No known effect explains it. It follows {found.text}{symbols}, 95 % interval {intervals}: a description, not "
        f"a cause. Held out, the error falls from {fit.arms['refit'].rmse:.3g} to {fit.arms['corrected'].rmse:.3g} "
        f"{fit.unit}.{also}"
    )


def _condition(location: Location) -> str:
    """The condition; for changes in time, the first of the stretches that hold most of the excess."""
    if all(place.condition == location.condition for place in location.places):
        return location.condition
    first = max(location.places, key=lambda place: place.share_of_excess)
    more = len(location.places) - 1
    others = f" and in {more} more stretch{'es' if more > 1 else ''} of time" if more else ""
    name = PurePath(first.recording).name
    start = f"all through {name}" if first.condition == WHOLE_RUN else f"{first.condition} in {name}"
    return start + others


def _parameters_off(evidence: Evidence, off: Sequence[ParameterOff], fit: Fit) -> str:
    told = ", ".join(f"{one.group} is {one.fitted:.3g} {one.unit}, not {one.assumed:.3g}" for one in off)
    told = told or "which of them, these recordings cannot tell"
    if [one.group for one in off] == [USABLE_ENERGY]:
        return (
            f"The robot file explains the recorded {_MEASURED[fit.unit]}, but not how fast the state of charge falls: "
            f"{told}."
        )
    before, after = fit.arms["nominal"].rmse, fit.arms["refit"].rmse
    return (
        f"The model's structure fits but its parameters are off: {told}. Held out, the error falls from "
        f"{before:.3g} to {after:.3g} {fit.unit} and nothing structured remains."
    )


def _no_mismatch(evidence: Evidence, off: Sequence[ParameterOff], fit: Fit) -> str:
    if evidence.nominal is None:
        return (
            "The model's structure explains the recorded motor current; the robot file gives no thrust per ampere "
            "(traction_n_per_a), so its parameters cannot be compared."
        )
    r2 = fit.arms["refit"].r2
    if r2 is not None and r2 < EXPLAINS:
        return (
            f"Nothing recorded speaks against the robot file: the refit is no better on held-out data and nothing "
            f"that remains depends on a recorded channel (false alarm rate {FALSE_ALARM_RATE:.0%})."
        )
    return (
        f"The robot file explains the recorded {_MEASURED[fit.unit]}: the refit is no better on held-out data and "
        f"nothing that remains depends on a recorded channel (false alarm rate {FALSE_ALARM_RATE:.0%})."
    )


def why_open(estimate: Estimate) -> str:
    """Why a group has no value, in a few words."""
    mixed = estimate.mixed_with
    return {
        "fitted": "fitted",
        "not excited": "has no influence on these recordings",
        "confounded": f"cannot be told apart from {', '.join(mixed)}" if mixed else "varies by measurement noise only",
        "too uncertain": "too uncertain to print",
        "at bound": "pulled to the bound of what is physical, so not a measurement",
    }[estimate.status]
