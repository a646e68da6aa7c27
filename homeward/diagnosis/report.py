"""What is written to the output folder: diagnosis.json, corrected.toml and a self-contained report.html."""

from __future__ import annotations

import html
import platform
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import plotly.graph_objects as go
import plotly.offline
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from homeward.diagnosis import wording
from homeward.diagnosis.chain import Analysis, Evidence
from homeward.diagnosis.correct import comments
from homeward.diagnosis.replay import WINDOW_S
from homeward.diagnosis.structure import FALSE_ALARM_RATE, SMALLEST_GAIN, Dependence
from homeward.files import write_whole

_MOST_RUNS = 12  # in the time plot
_MOST_POINTS = 2000
_RECORDED, _NOMINAL, _REFIT, _LOCATED = "#222222", "#9aa5b1", "#0b7285", "#e8590c"
_VERDICT_WORDS = {
    "no_mismatch": "No mismatch",
    "parameters_off": "Parameters off",
    "missing_physics": "Missing physics",
    "unknown_physics": "Unknown physics",
    "not_testable": "Not testable",
}


def write_outputs(analysis: Analysis, folder: Path) -> list[Path]:
    """Write diagnosis.json, corrected.toml and report.html, each whole or not at all.

    Raises:
        OSError: The folder cannot be written to.
    """
    check_writable(folder)
    texts = {
        "diagnosis.json": analysis.diagnosis.to_json(),
        "corrected.toml": corrected_toml(analysis),
        "report.html": report_html(analysis),
    }
    for name, text in texts.items():
        write_whole(folder / name, text)
    return [folder / name for name in texts]


def check_writable(folder: Path) -> None:
    """Make the output folder and see that a file can be written there, before any work is done.

    Raises:
        OSError: It cannot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def corrected_toml(analysis: Analysis) -> str:
    """Robot file with the fitted values, each changed line with what it was."""
    known = () if analysis.evidence is None else analysis.evidence.estimates
    changed = comments(analysis.robot, analysis.corrected, known)
    head = [f"# Written by diagnose.py for the robot file {analysis.robot.name!r}: {analysis.diagnosis.verdict}."]
    if not changed:
        head.append("# Nothing was changed.")
    open_groups = [f"{one.group.symbol} ({wording.why_open(one)})" for one in known if one.fitted is None]
    if open_groups:
        head.append(f"# Not identifiable from these recordings, and left as assumed: {', '.join(open_groups)}.")
    return "\n".join(head) + "\n" + analysis.corrected.to_toml(changed)


def report_html(analysis: Analysis) -> str:
    """The report as one page that needs no network; everything that was recorded or named by others is escaped."""
    environment = Environment(
        loader=PackageLoader("homeward.diagnosis"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["number"] = _number
    environment.filters["short"] = lambda path: PurePath(path).name
    evidence = analysis.evidence
    figures = {} if evidence is None else _figures(evidence)
    return environment.get_template("report.html").render(
        diagnosis=analysis.diagnosis,
        verdict=_VERDICT_WORDS[analysis.diagnosis.verdict],
        findings=_by_text(analysis),
        evidence=evidence,
        figures=figures,
        why_open=wording.why_open,
        shown=_shown_places(analysis),
        constants={"window_s": WINDOW_S, "false_alarm": FALSE_ALARM_RATE, "gain": SMALLEST_GAIN},
        versions=_versions(),
        plotly=Markup(plotly.offline.get_plotlyjs()) if figures else "",
    )


def _number(value: float | None, digits: int = 3) -> str:
    """A number as one writes it, a dash for none.

    >>> _number(1234.5), _number(0.0001234), _number(None), _number(2.0)
    ('1234', '0.000123', '–', '2')
    """
    if value is None or not np.isfinite(value):
        return "–"
    if abs(value) >= 10 ** (digits - 1):
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def _by_text(analysis: Analysis) -> dict[tuple[bool, str], list[str]]:
    """Names of the recordings under each finding, those set aside first."""
    grouped: dict[tuple[bool, str], list[str]] = {}
    for one in sorted(analysis.findings, key=lambda finding: not finding.refused):
        grouped.setdefault((one.refused, one.text), []).append(PurePath(one.recording).name)
    return grouped


def _shown_places(analysis: Analysis) -> list[Any]:
    places = sorted(analysis.diagnosis.where, key=lambda place: -place.share_of_excess)
    return places[:10]


def _versions() -> dict[str, str]:
    names = ("homeward", "numpy", "scipy", "numba", "pandas")
    found = {"python": platform.python_version()}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _figures(evidence: Evidence) -> dict[str, Markup]:
    figures = {"time": _time_figure(evidence)}
    if evidence.dependences:
        figures["condition"] = _condition_figure(evidence, evidence.dependences[0])
    return {name: _embedded(figure, name) for name, figure in figures.items()}


def _embedded(figure: go.Figure, name: str) -> Markup:
    figure.update_layout(
        template="plotly_white", margin={"l": 55, "r": 12, "t": 44, "b": 45}, font={"family": "system-ui, sans-serif"},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0},
    )  # fmt: skip
    text = figure.to_html(
        full_html=False, include_plotlyjs=False, div_id=f"figure-{name}", default_height="380px",
        config={"responsive": True, "displaylogo": False, "displayModeBar": False},
    )  # fmt: skip
    return Markup(text)


def _time_figure(evidence: Evidence) -> go.Figure:
    """Recorded against simulated, one run at a time, those with most of the excess first."""
    runs = evidence.runs
    order = _by_excess(evidence)[:_MOST_RUNS]
    figure, per_run = go.Figure(), []
    for shown, run in enumerate(order):
        here = np.flatnonzero(runs.run == run)
        here = here[:: max(1, len(here) // _MOST_POINTS)]
        time_s = np.round(runs.time_s[here] - runs.time_s[here[0]], 2)
        lines = [("recorded", runs.observed[here], _RECORDED, 1.2)]
        if evidence.nominal is not None:
            lines.append(("nominal", evidence.nominal[here], _NOMINAL, 1.5))
        lines.append(("refit, held out", evidence.refit[here], _REFIT, 1.8))
        if evidence.location is not None:
            inside = np.where(evidence.location.inside[here], runs.observed[here], np.nan)
            lines.append((_plain_text(evidence.location.condition), inside, _LOCATED, 2.2))
        for name, values, colour, width in lines:
            figure.add_scatter(x=time_s, y=np.round(values, 4), name=name, mode="lines", visible=shown == 0,
                               line={"color": colour, "width": width})  # fmt: skip
        per_run.append(len(lines))
    if len(order) > 1:
        buttons = [
            {
                "label": _plain_text(PurePath(runs.names[run]).name),
                "method": "update",
                "args": [{"visible": [k == shown for k, count in enumerate(per_run) for _ in range(count)]}],
            }
            for shown, run in enumerate(order)
        ]
        figure.update_layout(
            updatemenus=[{"buttons": buttons, "x": 1.0, "xanchor": "right", "y": 1.12, "yanchor": "bottom"}]
        )
    figure.update_xaxes(title_text="time in the run, s")
    figure.update_yaxes(title_text=_axis(evidence), rangemode="tozero")
    return figure


def _by_excess(evidence: Evidence) -> list[int]:
    error = (evidence.runs.observed - evidence.refit) ** 2
    return [int(run) for run in np.argsort(-np.bincount(evidence.runs.run, error), kind="stable")]


def _condition_figure(evidence: Evidence, shown: Dependence) -> go.Figure:
    """What the refit leaves over, against the channel that explains most of it."""
    runs, figure = evidence.runs, go.Figure()
    known = np.flatnonzero(shown.bin >= 0)
    known = known[:: max(1, len(known) // _MOST_POINTS)]
    residual = runs.observed - evidence.refit
    name = shown.channel.name
    if name == "time_s":
        first = np.array([runs.time_s[runs.run == run][0] for run in range(len(runs.signals))])
        values = runs.time_s - first[runs.run]
        centre = np.array([values[shown.bin == b].mean() for b in range(len(shown.effect))])
    else:
        values = np.abs(runs.context[name]) if shown.channel.magnitude else runs.context[name]
        centre = shown.centre
    order = np.argsort(centre)
    count = np.bincount(shown.bin[shown.bin >= 0], minlength=len(shown.effect))
    level = np.bincount(shown.bin[shown.bin >= 0], residual[shown.bin >= 0], minlength=len(count)) / np.maximum(
        count, 1
    )
    figure.add_scatter(x=np.round(values[known], 4), y=np.round(residual[known], 4), mode="markers", name="window",
                       marker={"size": 4, "color": _NOMINAL, "opacity": 0.5})  # fmt: skip
    figure.add_scatter(x=centre[order], y=level[order], name="mean, 95 %", line={"color": _LOCATED, "width": 2.5},
                       mode="markers" if name == "time_s" else "lines+markers",
                       error_y={"type": "data", "array": 1.96 * shown.error[order], "color": _LOCATED})  # fmt: skip
    figure.add_hline(y=0.0, line={"color": _RECORDED, "width": 1})
    unit = f", {shown.channel.unit}" if shown.channel.unit else ""
    figure.update_xaxes(title_text=f"{shown.channel.label}{unit}")
    figure.update_yaxes(title_text=f"recorded minus refit, {runs.unit}")
    return figure


def _axis(evidence: Evidence) -> str:
    return "battery power, W" if evidence.runs.unit == "W" else "motor current, A"


def _plain_text(text: str) -> str:
    """Text for a figure, which would read markup in it."""
    return html.escape("".join(c if c.isprintable() else "?" for c in text), quote=True)
