"""Plots of the report: recorded against simulated over time, and residuals against the channels
that explain them.

No string of a recording or robot file goes into a plot, which would interpret markup in it.
"""

import math
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
from homeward.diagnosis.result import Place
from homeward.diagnosis.tell.series import PARQUET
from homeward.layout.notation import number
from homeward.layout.plots import MOST_RUNS, embedded
from homeward.logs.channels import Array, Mask

_MOST_POINTS = 2000  # of a line; chosen: more than pixels
_MOST_DOTS = 800  # windows drawn behind the means; chosen
_SHOWN_S = 120.0  # of a long run at first; chosen: starts and stops can be distinguished
_INK = "#1f2933"
_GREY = "#7b8794"
_LINES: Mapping[str, Mapping[str, Any]] = {
    "recorded": {"color": _INK, "width": 1.2},
    "nominal": {"color": _GREY, "width": 1.6},
    "refit": {"color": "#c92a2a", "width": 1.6},
    "corrected": {"color": "#0b7285", "width": 1.7},
}
# Colours of shaded stretches. Of more effects than colours the first are shaded; the tables of the
# page have all.
_AT_WORK = ("rgba(240, 140, 0, 0.20)", "rgba(112, 72, 232, 0.18)", "rgba(43, 138, 62, 0.18)")

Stretch = tuple[float, float]
"""Start and end, s."""


def time_figure(analysis: Analysis, evidence: Evidence) -> tuple[Markup, list[dict[str, Any]]]:
    """Recorded against simulated before and after the correction, and the runs to choose from, the
    worst first.

    Of a run: the number of its traces in `meta`, its name and length, where to begin, and the
    vertical axis.
    """
    runs = evidence.runs
    predictions = evidence.predictions
    squared = (runs.observed - predictions["refit"]) ** 2
    runs_worst_first = np.argsort(-np.bincount(runs.run, squared), kind="stable")[
        :MOST_RUNS
    ].tolist()
    panels = [""]
    if "corrected" in predictions:
        panels = ["before: robot file and refit", "after: corrected"]
    figure = make_subplots(
        len(panels),
        1,
        shared_xaxes=True,
        shared_yaxes="all",
        vertical_spacing=0.07,
        subplot_titles=panels,
    )
    choices: list[dict[str, Any]] = []
    for number_shown, run in enumerate(runs_worst_first):
        time_s = runs.time_s[runs.run == run]
        since_start_s = time_s - time_s[0]
        lines = _lines_of_run(evidence, run)
        limits = _limits(np.concatenate(list(lines.values())))
        choice = {
            "number": number_shown,
            "name": runs.names[run],
            "length_s": round(float(since_start_s[-1]), 1),
        }
        choice["start_s"], choice["end_s"] = _worst_stretch(since_start_s, squared[runs.run == run])
        choice["low"], choice["high"] = limits
        choices.append(choice)
        places = _places(analysis, evidence, run)
        for row in range(1, len(panels) + 1):
            _add_places(figure, places, limits, row, number_shown)
            _add_lines(figure, _thinned(since_start_s), lines, row, number_shown)
    worst = choices[0]
    figure.update_xaxes(range=[worst["start_s"], worst["end_s"]])
    figure.update_xaxes(title_text="time in the run, s", row=len(panels))
    measured = "power, W" if runs.unit == "W" else "current, A"
    figure.update_yaxes(title_text=measured, range=[worst["low"], worst["high"]], fixedrange=True)
    simulated = ", ".join(name for name in _LINES if name in predictions)
    says = f"{measured} over time: recorded, and simulated by {simulated}. Every value is in {PARQUET}."
    return embedded(figure, "time", says, top=34, zooms=True), choices


def _lines_of_run(evidence: Evidence, run: int) -> dict[str, NDArray[np.float32]]:
    """What was recorded in a run and what each arm predicts, by the name of the line, thinned."""
    in_run = evidence.runs.run == run
    series = {"recorded": evidence.runs.observed, **evidence.predictions}
    return {name: _thinned(series[name][in_run]) for name in _LINES if name in series}


def _add_lines(
    figure: go.Figure,
    time_s: NDArray[np.float32],
    lines: Mapping[str, NDArray[np.float32]],
    row: int,
    number_shown: int,
) -> None:
    """Draw the lines of one run into a panel: the recorded one in both, the corrected one in the
    second only."""
    for name, values in lines.items():
        own_row = 2 if name == "corrected" else 1
        if name == "recorded" or row == own_row:
            # The page shows the traces of the run that is chosen, which it knows by `meta`; at
            # first the worst run.
            figure.add_scatter(
                x=time_s,
                y=values,
                name=name,
                mode="lines",
                line=_LINES[name],
                visible=number_shown == 0,
                meta=number_shown,
                showlegend=row == own_row,
                legendgroup=name,
                row=row,
                col=1,
            )


def _limits(
    values: NDArray[np.floating], beyond: float = 0.0, margin: float = 0.04
) -> tuple[float, float]:
    """Range of the vertical axis: all values but this share at either end, and zero, with a
    margin."""
    low, high = np.quantile(values, [beyond, 1.0 - beyond]).tolist()
    low = min(low, 0.0)
    high = max(high, 0.0)
    gap = margin * max(high - low, 1e-9)
    return round(low - gap, 3), round(high + gap, 3)


def _worst_stretch(time_s: Array, squared: Array) -> tuple[float, float]:
    """Start and end of the stretch with the largest error; all of a short run."""
    windows_shown = int(np.searchsorted(time_s, _SHOWN_S))
    if time_s[-1] < 1.5 * _SHOWN_S or windows_shown >= len(time_s):
        return 0.0, round(float(time_s[-1]), 1)
    # The sum over a stretch is the difference of the running sum at its ends.
    sums = np.concatenate(([0.0], np.cumsum(squared)))
    start = int(np.argmax(sums[windows_shown:] - sums[:-windows_shown]))
    start_s = float(time_s[start])
    return round(start_s, 1), round(start_s + _SHOWN_S, 1)


def _add_places(
    figure: go.Figure,
    places: Mapping[str, Sequence[Stretch]],
    limits: tuple[float, float],
    row: int,
    number_shown: int,
) -> None:
    """Shade stretches of one run, labelled by effect or condition."""
    low, high = limits
    for (label, ends), colour in zip(places.items(), _AT_WORK, strict=False):
        # One trace for all stretches of a label: a rectangle each, with a gap (None) behind it.
        x = [x for start_s, end_s in ends for x in (start_s, start_s, end_s, end_s, None)]
        y = [low, high, high, low, None] * len(ends)
        figure.add_scatter(
            x=x,
            y=y,
            name=label,
            mode="none",
            fill="toself",
            fillcolor=colour,
            hoverinfo="skip",
            visible=number_shown == 0,
            meta=number_shown,
            showlegend=row == 1 and bool(ends),
            legendgroup=label,
            row=row,
            col=1,
        )


def _places(analysis: Analysis, evidence: Evidence, run: int) -> dict[str, list[Stretch]]:
    """Where in a run each named effect is at work, or else where the mismatch was located; since
    its start."""
    runs = evidence.runs
    location = evidence.location
    origin_s = float(runs.time_s[runs.run == run][0])
    if analysis.diagnosis.missing_physics:
        return {
            f"at work: {effect.name}": _places_in_run(effect.where, runs.names[run], origin_s)
            for effect in analysis.diagnosis.missing_physics
        }
    if location is None:
        return {}
    # Times are those of the middle of a window.
    half_s = runs.duration_s / 2.0
    starts_s = runs.time_s - half_s
    ends_s = runs.time_s + half_s
    located = [
        _since(origin_s, float(starts_s[part][0]), float(ends_s[part][-1]))
        for _, part in stretches(location.inside & (runs.run == run), runs)
    ]
    return {f"located: {location.condition}": located}


def _places_in_run(places: Sequence[Place], recording: str, origin_s: float) -> list[Stretch]:
    return [
        _since(origin_s, place.start_s, place.end_s)
        for place in places
        if place.recording == recording
    ]


def _since(origin_s: float, start_s: float, end_s: float) -> Stretch:
    return round(start_s - origin_s, 1), round(end_s - origin_s, 1)


def _thinned(values: Array) -> NDArray[np.float32]:
    """Means over neighbours, so that at most `_MOST_POINTS` remain."""
    per_mean = math.ceil(len(values) / _MOST_POINTS)
    starts = np.arange(0, len(values), per_mean)
    return _rounded(np.add.reduceat(values, starts) / np.diff(starts, append=len(values)))


def conditions(analysis: Analysis, evidence: Evidence) -> list[dict[str, Any]]:
    """Residuals against the channel that shows each named effect, or that explains most where none
    was named.

    Of a channel: the dependence, the names of the effects that it shows, the figures before (the
    refit) and, where effects were named, after (corrected), and their means as rows of a table: the
    middle of a range of the channel, and mean and half its 95 % interval of each residual.
    """
    # names of effects by the index of the dependence that shows them
    effects_shown: dict[int, list[str]] = {}
    for effect in analysis.diagnosis.missing_physics:
        index_shown = _dependence_on(effect.effect, evidence)
        if index_shown is not None:
            effects_shown.setdefault(index_shown, []).append(effect.name)
    # The dependences are in their order, the strongest first.
    if not effects_shown and evidence.dependences:
        effects_shown = {0: []}
    arms = [arm for arm in ("refit", "corrected") if arm in evidence.predictions]
    residuals = {arm: evidence.runs.observed - evidence.predictions[arm] for arm in arms}
    shown = []
    for index, effects in effects_shown.items():
        dependence = evidence.dependences[index]
        bins = {arm: _bins(residual, dependence, evidence) for arm, residual in residuals.items()}
        figures = {
            arm: _condition_figure(
                arm, residuals, bins[arm], dependence, evidence, figure_name=f"{index}-{arm}"
            )
            for arm in arms
        }
        shown.append(
            {
                "dependence": dependence,
                "effects": effects,
                "rows": _rows(list(bins.values())),
                "before": figures["refit"],
                "after": figures.get("corrected"),
            }
        )
    return shown


def _rows(bins: Sequence[pd.DataFrame]) -> list[tuple[float, list[tuple[float, float]]]]:
    """For each bin the middle of its range, and mean and half the 95 % interval of each
    residual."""
    rows = []
    for row, centre in enumerate(bins[0]["centre"].tolist()):
        means = [float(of_arm["mean"].iloc[row]) for of_arm in bins]
        halves = [thresholds.NORMAL_95 * float(of_arm["error"].iloc[row]) for of_arm in bins]
        rows.append((centre, list(zip(means, halves, strict=True))))
    return rows


def _dependence_on(effect: str, evidence: Evidence) -> int | None:
    """Index of the dependence on the channel that shows an effect best; time for a schedule."""
    tested = [dependence.channel.name for dependence in evidence.dependences]
    terms = [named.term for named in evidence.naming.named if named.term.effect == effect]
    if any(term.schedule is not None and term.axis == "time" for term in terms):
        channels = ["time_s"]
    else:
        channels = [*CATALOGUE[effect].channels, *tested[:1]]
    for channel in channels:
        if channel in tested:
            return tested.index(channel)
    return None


def _condition_figure(
    arm: str,
    residuals: Mapping[str, Array],
    bins: pd.DataFrame,
    dependence: Dependence,
    evidence: Evidence,
    figure_name: str,
) -> Markup:
    """Residual of one arm against a channel: windows as dots, means over ranges of the channel with
    their intervals.

    The residuals of all arms give the range of the axis, so that the figures can be compared.
    """
    runs = evidence.runs
    channel = dependence.channel
    values = _values(dependence, runs)
    has_channel = dependence.bin >= 0
    figure = go.Figure()
    _add_dots(figure, values, residuals[arm], has_channel)
    _add_means(figure, values, bins, dependence, colour=_LINES[arm]["color"])
    figure.add_hline(y=0.0, line={"color": _INK, "width": 1})
    # The outermost windows may lie beyond the range.
    residuals_shown = np.concatenate([residual[has_channel] for residual in residuals.values()])
    limits = _limits(residuals_shown, beyond=0.005, margin=0.15)
    if channel.name == "time_s":
        label = "time, runs end to end, s"
    elif channel.unit:
        label = f"{channel.label}, {channel.unit}".replace("^2", "²")
    else:
        label = channel.label
    figure.update_layout(showlegend=False)
    figure.update_xaxes(title_text=label)
    figure.update_yaxes(title_text=f"recorded minus simulated, {runs.unit}", range=limits)
    extremes = [bins.iloc[bins["mean"].argmin()], bins.iloc[bins["mean"].argmax()]]
    span = " to ".join(
        f"{number(extreme['mean'])} at {number(extreme['centre'])}" for extreme in extremes
    )
    says = f"recorded minus simulated, {runs.unit}, against {label}: means from {span}. The table below has all means."
    return embedded(figure, figure_name, says)


def _add_dots(figure: go.Figure, values: Array, residual: Array, has_channel: Mask) -> None:
    """A dot for each window where the channel was recorded, or for some of many."""
    windows = np.flatnonzero(has_channel)
    windows = windows[:: math.ceil(len(windows) / _MOST_DOTS)]
    figure.add_scatter(
        x=_rounded(values[windows]),
        y=_rounded(residual[windows]),
        mode="markers",
        hoverinfo="skip",
        marker={"size": 4, "color": _GREY, "opacity": 0.45},
    )


def _add_means(
    figure: go.Figure, values: Array, bins: pd.DataFrame, dependence: Dependence, colour: str
) -> None:
    """Means with their 95 % intervals, joined by a line; over time each is a level over its
    stretch."""
    in_time = dependence.channel.name == "time_s"
    line = {"color": colour, "width": 2.5}
    half_intervals = _rounded(thresholds.NORMAL_95 * bins["error"])
    figure.add_scatter(
        x=_rounded(bins["centre"]),
        y=_rounded(bins["mean"]),
        name="mean, 95 %",
        mode="markers" if in_time else "lines+markers",
        line=line,
        marker={"size": 7, "color": colour},
        error_y={"type": "data", "array": half_intervals, "color": colour, "thickness": 1.5},
    )
    if in_time:
        x: list[float | None] = []
        y: list[float | None] = []
        for number_of_bin, level in bins["mean"].items():
            in_bin = values[dependence.bin == number_of_bin]
            x += [float(in_bin[0]), float(in_bin[-1]), None]
            y += [level, level, None]
        figure.add_scatter(x=x, y=y, mode="lines", line=line, hoverinfo="skip")


def _bins(residual: Array, dependence: Dependence, evidence: Evidence) -> pd.DataFrame:
    """For each bin the mean of a channel, in order, and that of the residual with its error
    clustered by block."""
    has_channel = dependence.bin >= 0
    values = _values(dependence, evidence.runs)[has_channel]
    bin_of_window = dependence.bin[has_channel]
    bins = (
        pd.DataFrame({"centre": values, "mean": residual[has_channel]})
        .groupby(bin_of_window)
        .mean()
    )
    mean_of_window = bins["mean"].to_numpy()[np.searchsorted(bins.index, bin_of_window)]
    deviation = pd.Series(residual[has_channel] - mean_of_window)
    # Deviations within a block may be correlated: they count as one, by their sum.
    squares = deviation.groupby([bin_of_window, evidence.block[has_channel]]).sum() ** 2
    bins["error"] = (
        np.sqrt(squares.groupby(level=0).sum()) / deviation.groupby(bin_of_window).size()
    )
    return bins.sort_values("centre")


def _values(dependence: Dependence, runs: Runs) -> Array:
    """Values of the channel, shape (windows,); of time, runs end to end; of others, without sign
    where only size matters."""
    channel = dependence.channel
    if channel.name == "time_s":
        steps_s = np.diff(runs.time_s, prepend=0.0)
        same_run = np.diff(runs.run, prepend=-1) == 0
        return np.cumsum(np.where(same_run, steps_s, 0.0))
    values = runs.context[channel.name]
    if channel.magnitude:
        values = np.abs(values)
    return values


def _rounded(values: Array | pd.Series) -> NDArray[np.float32]:
    """Values with few digits, for a small page."""
    return np.round(values, 4).astype(np.float32)
