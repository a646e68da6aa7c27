"""Plots of the report: recorded against simulated over time, and residuals against the channels that explain them.

No string of a recording or robot file goes into a plot, which would interpret markup in it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from markupsafe import Markup
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.places import stretches
from homeward.diagnosis.explain.residual_test import Dependence
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.tell.series import PARQUET
from homeward.layout.notation import number
from homeward.layout.plots import MOST_RUNS, embedded
from homeward.logs.channels import Array

_MOST_POINTS = 2000  # of a line; chosen: more than pixels
_MOST_DOTS = 800  # windows drawn behind the means; chosen
_SHOWN_S = 120.0  # of a long run at first; chosen: starts and stops can be distinguished
_INK, _NOMINAL, _REFIT, _CORRECTED = "#1f2933", "#7b8794", "#c92a2a", "#0b7285"
_LINES: Mapping[str, Mapping[str, Any]] = {
    "recorded": {"color": _INK, "width": 1.2},
    "nominal": {"color": _NOMINAL, "width": 1.6},
    "refit": {"color": _REFIT, "width": 1.6},
    "corrected": {"color": _CORRECTED, "width": 1.7},
}
_AT_WORK = ("rgba(240, 140, 0, 0.20)", "rgba(112, 72, 232, 0.18)", "rgba(43, 138, 62, 0.18)")

Stretch = tuple[float, float]
"""Start and end, s."""


def time_figure(analysis: Analysis, evidence: Evidence) -> tuple[Markup, list[dict[str, Any]]]:
    """Recorded against simulated before and after the correction, and the runs to choose from, the worst first.

    Of a run: the number of its traces in `meta`, its name and length, where to begin, and the vertical axis.
    """
    runs, predictions = evidence.runs, evidence.predictions
    squared = (runs.observed - evidence.predictions["refit"]) ** 2
    order = np.argsort(-np.bincount(runs.run, squared), kind="stable")[:MOST_RUNS].tolist()
    panels = ["before: robot file and refit", "after: corrected"] if "corrected" in predictions else [""]
    figure = make_subplots(
        len(panels), 1, shared_xaxes=True, shared_yaxes="all", vertical_spacing=0.07, subplot_titles=panels
    )
    everything, choices = {"recorded": runs.observed, **predictions}, []
    for shown, run in enumerate(order):
        here = runs.run == run
        since_s = runs.time_s[here] - runs.time_s[here][0]
        lines = {name: _thinned(everything[name][here]) for name in _LINES if name in everything}
        limits = _limits(np.concatenate(list(lines.values())))
        start_s, end_s = _worst_stretch(since_s, squared[here])
        about = {"number": shown, "name": runs.names[run], "length_s": round(float(since_s[-1]), 1)}
        choices.append({**about, "start_s": start_s, "end_s": end_s, "low": limits[0], "high": limits[1]})
        for row in range(1, len(panels) + 1):
            _add_places(figure, _places(analysis, evidence, run), limits, row, shown)
            for name, values in lines.items():
                if name == "recorded" or (name == "corrected") == (row == 2):
                    figure.add_scatter(
                        x=_thinned(since_s), y=values, name=name, mode="lines", line=_LINES[name], visible=shown == 0,
                        meta=shown, showlegend=row == 1 or name == "corrected", legendgroup=name, row=row, col=1,
                    )  # fmt: skip
    figure.update_xaxes(range=[choices[0]["start_s"], choices[0]["end_s"]])
    figure.update_xaxes(title_text="time in the run, s", row=len(panels))
    measured = "power, W" if runs.unit == "W" else "current, A"
    figure.update_yaxes(title_text=measured, range=[choices[0]["low"], choices[0]["high"]], fixedrange=True)
    simulated = ", ".join(name for name in _LINES if name in predictions)
    says = f"{measured} over time: recorded, and simulated by {simulated}"
    return embedded(figure, "time", f"{says}. Every value is in {PARQUET}.", top=34, zooms=True), choices


def _limits(values: NDArray[np.floating], beyond: float = 0.0, margin: float = 0.04) -> tuple[float, float]:
    """Range of the vertical axis: all values but this share at either end, and zero, with a margin."""
    low, high = np.quantile(values, [beyond, 1.0 - beyond]).tolist()
    low, high = min(low, 0.0), max(high, 0.0)
    wider = margin * max(high - low, 1e-9)
    return round(low - wider, 3), round(high + wider, 3)


def _worst_stretch(time_s: Array, squared: Array) -> tuple[float, float]:
    """Start and end of the stretch with the largest error; all of a short run."""
    count = int(np.searchsorted(time_s, _SHOWN_S))
    if time_s[-1] < 1.5 * _SHOWN_S or count >= len(time_s):
        return 0.0, round(float(time_s[-1]), 1)
    sums = np.concatenate(([0.0], np.cumsum(squared)))
    first = int(np.argmax(sums[count:] - sums[:-count]))
    return round(float(time_s[first]), 1), round(float(time_s[first]) + _SHOWN_S, 1)


def _add_places(
    figure: go.Figure, places: Mapping[str, Sequence[Stretch]], limits: tuple[float, float], row: int, shown: int
) -> None:
    """Shade stretches of one run, labelled by effect or condition."""
    low, high = limits
    for (label, found), colour in zip(places.items(), _AT_WORK, strict=False):
        figure.add_scatter(
            x=[x for start, end in found for x in (start, start, end, end, None)],
            y=[low, high, high, low, None] * len(found), name=label, mode="none",
            fill="toself", fillcolor=colour, hoverinfo="skip", visible=shown == 0, meta=shown,
            showlegend=row == 1 and bool(found), legendgroup=label, row=row, col=1,
        )  # fmt: skip


def _places(analysis: Analysis, evidence: Evidence, run: int) -> dict[str, list[Stretch]]:
    """Where in a run each named effect is at work, or else where the mismatch was located; since its start."""
    runs, location = evidence.runs, evidence.location
    origin_s = float(runs.time_s[runs.run == run][0])
    found = {
        f"at work: {one.name}": [(at.start_s, at.end_s) for at in one.where if at.recording == runs.names[run]]
        for one in analysis.diagnosis.missing_physics
    }
    if not found and location is not None:
        half_s = runs.duration_s / 2.0
        found[f"located: {location.condition}"] = [
            (float((runs.time_s - half_s)[part][0]), float((runs.time_s + half_s)[part][-1]))
            for _, part in stretches(location.inside & (runs.run == run), runs)
        ]
    return {label: [(round(a - origin_s, 1), round(b - origin_s, 1)) for a, b in ends] for label, ends in found.items()}


def _thinned(values: Array) -> NDArray[np.float32]:
    """Means over neighbours, so that at most `_MOST_POINTS` remain."""
    starts = np.arange(0, len(values), -(-len(values) // _MOST_POINTS))
    return _rounded(np.add.reduceat(values, starts) / np.diff(starts, append=len(values)))


def conditions(analysis: Analysis, evidence: Evidence) -> list[dict[str, Any]]:
    """Residuals against the channel that shows each named effect, or that explains most where none was named.

    Of a channel: the dependence, the names of the effects that it shows, the figures before (the refit) and, where
    effects were named, after (corrected), and their means as rows of a table: the middle of a range of the channel, and
    mean and half its 95 % interval of each residual.
    """
    chosen: dict[int, list[str]] = {}
    for one in analysis.diagnosis.missing_physics:
        if (index := _dependence_on(one.effect, evidence)) is not None:
            chosen.setdefault(index, []).append(one.name)
    if not chosen and evidence.dependences:
        chosen = {0: []}
    names = [name for name in ("refit", "corrected") if name in evidence.predictions]
    residuals = [evidence.runs.observed - evidence.predictions[name] for name in names]
    found = []
    for index, effects in chosen.items():
        dependence = evidence.dependences[index]
        bins = [_bins(residual, dependence, evidence) for residual in residuals]
        before, *after = (
            _condition_figure(residual, dependence, evidence, means, name, index, residuals)
            for name, residual, means in zip(names, residuals, bins, strict=True)
        )
        rows = [
            (centre, [(float(one["mean"].iloc[i]), thresholds.NORMAL_95 * float(one["error"].iloc[i])) for one in bins])
            for i, centre in enumerate(bins[0]["centre"].tolist())
        ]
        figures = {"before": before, "after": next(iter(after), None)}
        found.append({"dependence": dependence, "effects": effects, "rows": rows, **figures})
    return found


def _dependence_on(effect: str, evidence: Evidence) -> int | None:
    """Index of the dependence on the channel that shows an effect best; time for a schedule."""
    scheduled = any(
        one.term.effect == effect and one.term.schedule is not None and one.term.axis == "time"
        for one in evidence.naming.named
    )
    tested = [one.channel.name for one in evidence.dependences]
    wanted = ("time_s",) if scheduled else (*CATALOGUE[effect].channels, tested[0] if tested else "")
    return next((tested.index(name) for name in wanted if name in tested), None)


def _condition_figure(
    residual: Array, shown: Dependence, evidence: Evidence, bins: pd.DataFrame, arm: str, index: int,
    pair: Sequence[Array],
) -> Markup:  # fmt: skip
    """One residual against a channel: windows as dots, means over ranges of the channel with their intervals."""
    runs, known, colour = evidence.runs, shown.bin >= 0, _LINES[arm]["color"]
    values = _values(shown, runs)
    dots = np.flatnonzero(known)
    dots = dots[:: -(-len(dots) // _MOST_DOTS)]
    in_time = shown.channel.name == "time_s"
    figure = go.Figure()
    figure.add_scatter(
        x=_rounded(values[dots]), y=_rounded(residual[dots]), mode="markers", hoverinfo="skip",
        marker={"size": 4, "color": _NOMINAL, "opacity": 0.45},
    )  # fmt: skip
    figure.add_scatter(
        x=_rounded(bins["centre"]), y=_rounded(bins["mean"]), name="mean, 95 %",
        mode="markers" if in_time else "lines+markers",
        line={"color": colour, "width": 2.5}, marker={"size": 7, "color": colour},
        error_y={
            "type": "data", "array": _rounded(thresholds.NORMAL_95 * bins["error"]), "color": colour, "thickness": 1.5,
        },
    )  # fmt: skip
    if in_time:
        ends = np.array([(values[shown.bin == one][0], values[shown.bin == one][-1]) for one in bins.index])
        figure.add_scatter(
            x=[x for start, end in ends.tolist() for x in (start, end, None)],
            y=[y for level in bins["mean"] for y in (level, level, None)],
            mode="lines", line={"color": colour, "width": 2.5}, hoverinfo="skip",
        )  # fmt: skip
    figure.add_hline(y=0.0, line={"color": _INK, "width": 1})
    # One range for both residuals, so that they can be compared; the outermost windows may lie beyond it.
    limits = _limits(np.concatenate([one[known] for one in pair]), beyond=0.005, margin=0.15)
    unit = f", {shown.channel.unit}" if shown.channel.unit else ""
    label = "time, runs end to end, s" if in_time else f"{shown.channel.label}{unit}".replace("^2", "²")
    figure.update_layout(showlegend=False)
    figure.update_xaxes(title_text=label)
    figure.update_yaxes(title_text=f"recorded minus simulated, {runs.unit}", range=limits)
    means, centres = bins["mean"].to_numpy(), bins["centre"].to_numpy()
    both = " to ".join(f"{number(means[i])} at {number(centres[i])}" for i in (means.argmin(), means.argmax()))
    says = f"recorded minus simulated, {runs.unit}, against {label}: means from {both}. The table below has all means."
    return embedded(figure, f"{index}-{arm}", says)


def _bins(residual: Array, shown: Dependence, evidence: Evidence) -> pd.DataFrame:
    """For each bin the mean of a channel, in order, and that of the residual with its error clustered by block."""
    known = shown.bin >= 0
    values, number = _values(shown, evidence.runs)[known], shown.bin[known]
    bins = pd.DataFrame({"centre": values, "mean": residual[known]}).groupby(number).mean()
    off = pd.Series(residual[known] - bins["mean"].to_numpy()[np.searchsorted(bins.index, number)])
    squares = off.groupby([number, evidence.block[known]]).sum() ** 2
    bins["error"] = np.sqrt(squares.groupby(level=0).sum()) / off.groupby(number).size()
    return bins.sort_values("centre")


def _values(shown: Dependence, runs: Runs) -> Array:
    if shown.channel.name == "time_s":
        steps_s = np.diff(runs.time_s, prepend=0.0)
        return np.cumsum(np.where(np.diff(runs.run, prepend=-1) == 0, steps_s, 0.0))
    values = runs.context[shown.channel.name]
    return np.abs(values) if shown.channel.magnitude else values


def _rounded(values: Array | pd.Series) -> NDArray[np.float32]:
    """Values with few digits, for a small page."""
    return np.round(values, 4).astype(np.float32)
