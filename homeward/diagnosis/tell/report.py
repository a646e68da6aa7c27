"""Files of the output folder: diagnosis.json, corrected.toml, a self-contained report.html, time
series."""

import dataclasses
import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import plotly.offline
from markupsafe import Markup

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.conditions import CONDITIONS, TOGETHER
from homeward.diagnosis.explain.named import Named, Naming
from homeward.diagnosis.explain.places import condition, total_share
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.diagnosis.result import Place
from homeward.diagnosis.tell.corrected import comments
from homeward.diagnosis.tell.figures import conditions, time_figure
from homeward.diagnosis.tell.next_drive import GUIDE
from homeward.diagnosis.tell.robot_uncertainty import uncertainty_of
from homeward.diagnosis.tell.series import MCAP, PARQUET, mcap, series
from homeward.diagnosis.tell.words import ARMS, PAPER_ACCURACY, UNLIMITED, spanned, why_open
from homeward.files import write_files
from homeward.layout.notation import labels, page, templates

_FORMS = {"steady": "steady", "time": "in time", "place": "by place"}


def write_outputs(analysis: Analysis, folder: str | Path) -> list[Path]:
    """Write diagnosis.json, corrected.toml, report.html and, of usable runs, series.parquet and
    series.mcap, each whole or not at all; no series.mcap where `rosbags` is not installed.

    Raises:
        OSError: The folder cannot be written to.
    """
    files: dict[str, str | bytes] = {
        "diagnosis.json": analysis.diagnosis.to_json(),
        "corrected.toml": corrected_toml(analysis),
        "report.html": report_html(analysis),
    }
    if analysis.evidence is not None:
        table = series(analysis.evidence)
        files[PARQUET] = table.to_parquet(index=False)
        as_mcap = mcap(table)
        if as_mcap is not None:
            files[MCAP] = as_mcap
    return write_files(folder, files)


def corrected_toml(analysis: Analysis) -> str:
    """Robot file with the fitted values; a comment on each changed line gives the old one."""
    evidence = analysis.evidence
    file = analysis.diagnosis.file
    numbers = () if file is None else file.numbers
    changed = comments(analysis.robot, analysis.corrected, numbers)
    head = [
        f"# Written by diagnose.py for the robot file {analysis.robot.name!r}: {analysis.diagnosis.verdict}."
    ]
    if not changed:
        head.append("# Nothing was changed.")
    if evidence is not None:
        open_estimates = [estimate for estimate in evidence.estimates if estimate.fitted is None]
        if open_estimates:
            open_groups = [
                f"{estimate.group.symbol} ({why_open(estimate)})" for estimate in open_estimates
            ]
            head.append(f"# Not identifiable from these recordings: {', '.join(open_groups)}.")
        if evidence.held:
            head.append(f"# Held as assumed: {', '.join(evidence.held)}.")
    written = dataclasses.replace(analysis.corrected, uncertainty=uncertainty_of(analysis))
    return "\n".join(head) + "\n" + written.to_toml(changed)


def report_html(analysis: Analysis) -> str:
    """The report as one page that needs no network; all text from recordings and robot files is
    escaped."""
    diagnosis = analysis.diagnosis
    evidence = analysis.evidence
    paths = [recording.path for recording in diagnosis.recordings]
    names = labels(paths + [finding.recording for finding in analysis.findings])
    environment = templates("homeward.diagnosis.tell")
    environment.filters["label"] = lambda path: names.get(path, path)
    environment.filters["spanned"] = spanned
    values: dict[str, object] = {
        "diagnosis": diagnosis,
        "evidence": evidence,
        "verdict": diagnosis.verdict.replace("_", " ").capitalize(),
        "findings": _by_text(analysis),
        "where": _where(analysis),
        "condition": condition,
        "guide": GUIDE,
        "thresholds": thresholds,
        "table": CONDITIONS,
        "table_together": TOGETHER,
        "arms": ARMS,
        "paper_accuracy": PAPER_ACCURACY,
        "unlimited": UNLIMITED,
        "versions": _versions(),
        "robot_sha256": hashlib.sha256(analysis.robot.to_toml().encode()).hexdigest(),
    }
    if evidence is not None:
        figure, shown_runs = time_figure(analysis, evidence)
        visible, invisible = _can_show(analysis, evidence)
        values |= {
            "plotly": Markup(plotly.offline.get_plotlyjs()),
            "time_figure": figure,
            "shown_runs": shown_runs,
            "window_s": WINDOW_S,
            "conditions": conditions(analysis, evidence),
            "ranking": ranking(evidence.naming),
            "why_open": why_open,
            "visible": visible,
            "invisible": invisible,
        }
    return page(environment, "report.html", **values)


def _by_text(analysis: Analysis) -> dict[tuple[bool, str], list[str]]:
    """The recordings under each finding, those excluded first."""
    grouped: dict[tuple[bool, str], list[str]] = {}
    for finding in sorted(analysis.findings, key=lambda finding: not finding.refused):
        grouped.setdefault((finding.refused, finding.text), []).append(finding.recording)
    return grouped


def _where(analysis: Analysis) -> list[tuple[str, tuple[Place, ...], float | None]]:
    """Of each effect, or else of the mismatch: its name, its places, and its share of all that was
    recorded."""
    diagnosis = analysis.diagnosis
    evidence = analysis.evidence
    if diagnosis.missing_physics and evidence is not None:
        effects = zip(diagnosis.missing_physics, evidence.contributions, strict=True)
        return [
            (effect.name, effect.where, total_share(added, evidence.runs))
            for effect, added in effects
        ]
    if diagnosis.where:
        return [("The mismatch", diagnosis.where, None)]
    return []


@dataclass(frozen=True)
class RankRow:
    """One hypothesis of the ranking; `note` explains its mark."""

    effect: str
    form: str
    delta_bic: float
    held_out_gain: float
    kind: str  # "named", "rival" or ""
    note: str


def ranking(naming: Naming) -> list[RankRow]:
    """The named effects, each scored beside those named before it, then every other hypothesis
    scored alone."""
    rows: list[RankRow] = []
    rivalry: dict[tuple[str, str], str] = {}  # note on a rival, by effect and axis
    for index, named in enumerate(naming.named):
        name = named.term.hypothesis.name
        rows.append(
            RankRow(
                effect=named.term.effect,
                form=_FORMS[named.term.axis],
                delta_bic=named.delta_bic,
                held_out_gain=named.held_out_gain,
                kind="named",
                note=_note(named, naming.named[:index]),
            )
        )
        for rival in named.rivals:
            rivalry[rival.effect, rival.axis] = f"cannot be distinguished from {name}"
    named_forms = {(named.term.effect, named.term.axis) for named in naming.named}
    for ranked in naming.ranking:
        form = (ranked.effect, ranked.axis)
        if form in named_forms:
            continue
        note = rivalry.get(form, "")
        if not rows and ranked.delta_bic > thresholds.STRONG_BIC:
            note = "not named: its gain is not significant"
        rows.append(
            RankRow(
                effect=ranked.effect,
                form=_FORMS[ranked.axis],
                delta_bic=ranked.delta_bic,
                held_out_gain=ranked.held_out_gain,
                kind="rival" if form in rivalry else "",
                note=note,
            )
        )
    return rows


def _note(named: Named, named_before: Sequence[Named]) -> str:
    """Beside which effects one was named, and the figures for it."""
    how = "named"
    if named_before:
        names_before = ", ".join(effect.term.hypothesis.name for effect in named_before)
        how = f"named beside {names_before}"
    low, high = named.gain_ci95
    gain = f"gain {100.0 * low:.0f} to {100.0 * high:.0f} %"
    return f"{how}: {gain}, placebos p ≤ {named.p_value:.2g}"


def _can_show(
    analysis: Analysis, evidence: Evidence
) -> tuple[list[tuple[str, float]], dict[str, list[str]]]:
    """Effects with the share that the refit would absorb, least first; by reason those not
    identifiable."""
    visible: list[tuple[str, float]] = []
    invisible: dict[str, list[str]] = {}
    for effect, share in analysis.diagnosis.what_this_log_can_show.items():
        if share is not None:
            visible.append((effect, share))
            continue
        hypothesis = CATALOGUE[effect]
        channels = hypothesis.missing(evidence.runs)
        reason = "Confounded with the parameters in these recordings"
        needs = ""
        if evidence.runs.unit == "A" and not hypothesis.of_current:
            reason = "Not visible in motor current, which is proportional to torque"
        elif channels:
            reason = "A channel is missing"
            needs = f" (needs {', '.join(channels)})"
        invisible.setdefault(reason, []).append(hypothesis.name + needs)
    return sorted(visible, key=lambda effect_and_share: effect_and_share[1]), invisible


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for package in ("homeward", "numpy", "scipy", "numba", "pandas"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return versions
