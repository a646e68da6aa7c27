"""Files of the output folder: diagnosis.json, corrected.toml, a self-contained report.html, time series."""

import dataclasses
import hashlib
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import plotly.offline
from markupsafe import Markup

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.conditions import CONDITIONS, TOGETHER
from homeward.diagnosis.explain.naming import Naming
from homeward.diagnosis.explain.places import condition, total_share
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.diagnosis.result import Place
from homeward.diagnosis.tell.corrected import comments
from homeward.diagnosis.tell.figures import conditions, time_figure
from homeward.diagnosis.tell.next_drive import GUIDE
from homeward.diagnosis.tell.robot_uncertainty import uncertainty_of
from homeward.diagnosis.tell.series import MCAP, PARQUET, mcap, series
from homeward.diagnosis.tell.words import ARMS, PAPER_ACCURACY, why_open
from homeward.files import write_files
from homeward.layout.notation import labels, page, templates

_FORMS = {"steady": "steady", "time": "in time", "place": "by place"}


def write_outputs(analysis: Analysis, folder: str | Path) -> list[Path]:
    """Write diagnosis.json, corrected.toml, report.html and, of usable runs, series.parquet and series.mcap, each whole
    or not at all; no series.mcap where `rosbags` is not installed.

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
        if (content := mcap(table)) is not None:
            files[MCAP] = content
    return write_files(folder, files)


def corrected_toml(analysis: Analysis) -> str:
    """Robot file with the fitted values; a comment on each changed line gives the old one."""
    known = () if analysis.evidence is None else analysis.evidence.estimates
    file = analysis.diagnosis.file
    changed = comments(analysis.robot, analysis.corrected, file.numbers if file is not None else ())
    head = [f"# Written by diagnose.py for the robot file {analysis.robot.name!r}: {analysis.diagnosis.verdict}."]
    head += [] if changed else ["# Nothing was changed."]
    if open_groups := [f"{one.group.symbol} ({why_open(one)})" for one in known if one.fitted is None]:
        head.append(f"# Not identifiable from these recordings: {', '.join(open_groups)}.")
    if analysis.evidence is not None and analysis.evidence.held:
        head.append(f"# Held as assumed: {', '.join(analysis.evidence.held)}.")
    written = dataclasses.replace(analysis.corrected, uncertainty=uncertainty_of(analysis))
    return "\n".join(head) + "\n" + written.to_toml(changed)


def report_html(analysis: Analysis) -> str:
    """The report as one page that needs no network; all text from recordings and robot files is escaped."""
    diagnosis, evidence = analysis.diagnosis, analysis.evidence
    names = labels([one.path for one in diagnosis.recordings] + [one.recording for one in analysis.findings])
    environment = templates("homeward.diagnosis.tell")
    environment.filters["label"] = lambda path: names.get(path, path)
    values: dict[str, object] = {
        "diagnosis": diagnosis, "verdict": diagnosis.verdict.replace("_", " ").capitalize(), "evidence": evidence,
        "findings": _by_text(analysis), "where": _where(analysis), "condition": condition, "versions": _versions(),
        "guide": GUIDE, "thresholds": thresholds, "table": CONDITIONS, "table_together": TOGETHER,
        "arms": ARMS, "paper_accuracy": PAPER_ACCURACY,
        "robot_sha256": hashlib.sha256(analysis.robot.to_toml().encode()).hexdigest(),
    }  # fmt: skip
    if evidence is not None:
        figure, shown_runs = time_figure(analysis, evidence)
        visible, invisible = _can_show(analysis, evidence)
        values |= {
            "plotly": Markup(plotly.offline.get_plotlyjs()), "time_figure": figure, "shown_runs": shown_runs,
            "conditions": conditions(analysis, evidence), "ranking": ranking(evidence.naming), "why_open": why_open,
            "visible": visible, "invisible": invisible, "window_s": WINDOW_S,
        }  # fmt: skip
    return page(environment, "report.html", **values)


def _by_text(analysis: Analysis) -> dict[tuple[bool, str], list[str]]:
    """The recordings under each finding, those excluded first."""
    grouped: dict[tuple[bool, str], list[str]] = {}
    for one in sorted(analysis.findings, key=lambda finding: not finding.refused):
        grouped.setdefault((one.refused, one.text), []).append(one.recording)
    return grouped


def _where(analysis: Analysis) -> list[tuple[str, tuple[Place, ...], float | None]]:
    """Of each effect, or else of the mismatch: its name, its places, and its share of all that was recorded."""
    diagnosis, evidence = analysis.diagnosis, analysis.evidence
    if diagnosis.missing_physics and evidence is not None:
        return [
            (one.name, one.where, total_share(added, evidence.runs))
            for one, added in zip(diagnosis.missing_physics, evidence.contributions, strict=True)
        ]
    return [("The mismatch", diagnosis.where, None)] if diagnosis.where else []


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
    """The named effects, each scored beside those named before it, then every other hypothesis scored alone."""
    rows: list[RankRow] = []
    kinds: dict[tuple[str, str], tuple[str, str]] = {}
    for index, one in enumerate(naming.named):
        before = ", ".join(other.term.hypothesis.name for other in naming.named[:index])
        low, high = (100.0 * end for end in one.gain_ci95)
        alone = f"named beside {before}" if before else "named"
        note = f"{alone}: gain {low:.0f} to {high:.0f} %, placebos p ≤ {one.p_value:.2g}"
        form = _FORMS[one.term.axis]
        rows.append(RankRow(one.term.effect, form, one.delta_bic, one.held_out_gain, "named", note))
        rivalled = f"cannot be distinguished from {one.term.hypothesis.name}"
        kinds |= {(rival.effect, rival.axis): ("rival", rivalled) for rival in one.rivals}
    named = {(one.term.effect, one.term.axis) for one in naming.named}
    for other in naming.ranking:
        kind, note = kinds.get((other.effect, other.axis), ("", ""))
        if not rows and other.delta_bic > thresholds.STRONG_BIC:
            note = "not named: its gain is not significant"
        if (other.effect, other.axis) not in named:
            rows.append(RankRow(other.effect, _FORMS[other.axis], other.delta_bic, other.held_out_gain, kind, note))
    return rows


def _can_show(analysis: Analysis, evidence: Evidence) -> tuple[list[tuple[str, float]], dict[str, list[str]]]:
    """Effects with the share that the refit would absorb, least first; by reason those not identifiable."""
    shares = analysis.diagnosis.what_this_log_can_show
    visible = sorted(((effect, share) for effect, share in shares.items() if share is not None), key=lambda one: one[1])
    unseen: dict[str, list[str]] = {}
    for effect, share in shares.items():
        if share is not None:
            continue
        one, why, needs = CATALOGUE[effect], "Confounded with the parameters in these recordings", ""
        if evidence.runs.unit == "A" and not one.of_current:
            why = "Not visible in motor current, which is proportional to torque"
        elif channels := one.missing(evidence.runs):
            why, needs = "A channel is missing", f" (needs {', '.join(channels)})"
        unseen.setdefault(why, []).append(one.name + needs)
    return visible, unseen


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in ("homeward", "numpy", "scipy", "numba", "pandas"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
