"""The page of `homeward watch`: predictions against measured values, and their quality."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
import plotly.offline
from markupsafe import Markup
from plotly.subplots import make_subplots

from homeward import quantities
from homeward.layout.notation import labels, page, templates
from homeward.layout.plots import GRID, MOST_RUNS, PLAIN, described
from homeward.physics import Robot
from homeward.watch import thresholds
from homeward.watch.coverage import Row, rows_of
from homeward.watch.predictions import Watched
from homeward.watch.scores import missing, transforms_of

_ROWS = 6
"""Moments of a run in the table below its plot. Chosen: a line for each fifth of the way."""
_RESTS = {"J": "energy of the rest, kJ", "A s": "charge of the rest, kA s"}
_BINS = 10
"""Bars of the histogram of the probability integral transform. Chosen: the interval leaves a half
of the outer ones."""
_INK, _PREDICTED, _BAND = "#1f2933", "#0b7285", "rgba(11, 114, 133, 0.18)"


def watch_html(
    runs: Sequence[Watched],
    robot: Robot,
    dropped: Sequence[str] = (),
    notes: Sequence[tuple[str, str]] = (),
) -> str:
    """The page, which needs no network; names from files are escaped.

    Args:
        runs: Predictions of at least one run.
        robot: The robot.
        dropped: Messages about recordings that were left out.
        notes: Notes on reading: file names with their messages.
    """
    environment = templates("homeward.watch")
    environment.filters |= {
        "signed": lambda share: f"{100.0 * share:+.1f} %",
        "distance": quantities.distance,
        "duration": quantities.duration,
    }
    names = labels([run.name for run in runs])
    rows = rows_of(runs)
    return page(
        environment, "watch.html", runs=runs, names=names, rows=rows, robot=robot.name, dropped=list(dropped),
        notes=list(notes), verdict=verdict(rows[-1]), rests_on=runs[0].rests_on, drawn=min(len(runs), MOST_RUNS),
        plotly=Markup(plotly.offline.get_plotlyjs()), figure=figure(runs), transforms=transforms_figure(runs),
        lacking=missing(),
        moments=moments, rest=_RESTS[runs[0].unit],
    )  # fmt: skip


def verdict(row: Row) -> str:
    """Conclusion from the row of all moments, in a sentence."""
    fewest, most = thresholds.CALIBRATED
    how_often = "as often as it should"
    if row.covered < fewest:
        how_often = "too rarely: it is overconfident"
    elif row.covered > most:
        how_often = "too often: it could be narrower"
    direction = "high" if row.bias > 0.0 else "low"
    return (
        f"The 90 % interval contained the consumption of the rest at {100.0 * row.covered:.0f} % of "
        f"{row.moments} moments, {how_often}. On average it was {abs(100.0 * row.bias):.1f} % too {direction}."
    )


def figure(runs: Sequence[Watched]) -> Markup:
    """Energy of the rest over the way left, predicted with its interval and as measured; a panel a
    run."""
    shown = list(runs[:MOST_RUNS])
    count = len(shown)
    titles = [str(number) for number in range(1, count + 1)] if count > 1 else None
    spacing = min(0.35 / max(count, 1), 0.12)
    panels = make_subplots(count, 1, vertical_spacing=spacing, subplot_titles=titles)
    for row, run in enumerate(shown, start=1):
        around = np.concatenate((run.left_m, run.left_m[::-1])).round(1)
        band = np.concatenate((run.high_j, run.low_j[::-1])) / 1000.0
        has_legend = row == 1
        panels.add_scatter(
            x=around, y=band.round(4), fill="toself", fillcolor=_BAND, mode="none", name="90 % interval",
            hoverinfo="skip", showlegend=has_legend, legendgroup="band", row=row, col=1,
        )  # fmt: skip
        for name, values, colour in (
            ("predicted", run.mean_j, _PREDICTED),
            ("what it consumed", run.took_j, _INK),
        ):
            panels.add_scatter(
                x=run.left_m.round(1), y=(values / 1000.0).round(4), mode="lines", name=name,
                line={"color": colour, "width": 1.6}, showlegend=has_legend, legendgroup=name, row=row, col=1,
            )  # fmt: skip
        panels.update_yaxes(
            title_text=_RESTS[run.unit], rangemode="tozero", fixedrange=True, row=row, col=1
        )
        panels.update_xaxes(
            title_text="way left, m", autorange="reversed", fixedrange=True, row=row, col=1
        )
    # in the middle, they would touch the title of the axis above
    panels.update_annotations(x=0.0, xanchor="left")
    count_word = "run" if count == 1 else "runs"
    alternative = (
        f"{_RESTS[shown[0].unit]}, over the way left in m, of {count} {count_word}: predicted with its 90 % "
        "interval, and what it consumed. The table below has moments of each run, watch.csv has all."
    )
    return _image(panels, 90 + 260 * count, alternative)


def transforms_figure(runs: Sequence[Watched]) -> Markup:
    """Histogram of the probability integral transform over the moments of all runs."""
    values = np.concatenate([transforms_of(run) for run in runs])
    counts, edges = np.histogram(values, _BINS, (0.0, 1.0))
    shares = counts / len(values)
    middles = 0.5 * (edges[1:] + edges[:-1])
    histogram = go.Figure()
    histogram.add_bar(
        x=middles.round(3),
        y=(100.0 * shares).round(2),
        width=1.0 / _BINS,
        marker={"color": _PREDICTED},
    )
    histogram.update_traces(marker_line={"color": "white", "width": 1})
    histogram.add_hline(100.0 / _BINS, line={"color": _INK, "width": 1.6, "dash": "dot"})
    histogram.update_xaxes(
        title_text="probability of a lower consumption, by the prediction", range=[0.0, 1.0]
    )
    histogram.update_yaxes(title_text="moments, %", rangemode="tozero")
    in_each = ", ".join(f"{share:.0%}" for share in shares)
    alternative = (
        f"Share of {len(values)} moments in each tenth of the probability integral transform, from 0 to 1: {in_each}; "
        "10 % in each if calibrated."
    )
    return _image(histogram, 300, alternative)


def _image(plot: go.Figure, height_px: int, alternative: str) -> Markup:
    """A plot with a text alternative, for a page."""
    plot.update_layout(
        height=height_px, margin={"l": 60, "r": 15, "t": 30, "b": 45}, dragmode=False,
        legend={"orientation": "h", "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom"}, **PLAIN,
    )  # fmt: skip
    plot.update_xaxes(fixedrange=True, **GRID)
    plot.update_yaxes(fixedrange=True, **GRID)
    content = plot.to_html(
        full_html=False, include_plotlyjs=False, config={"displayModeBar": False}
    )
    return described(content, alternative)


def moments(run: Watched) -> list[tuple[float, ...]]:
    """Rows of a run's table: way left, m; predicted mean, ends of its interval, and measured value,
    kJ or kA s."""
    places = np.unique(np.linspace(0, len(run.left_m) - 1, _ROWS).astype(int))
    rows = []
    for place in places:
        in_kj = [
            float(values[place]) / 1000.0
            for values in (run.mean_j, run.low_j, run.high_j, run.took_j)
        ]
        rows.append((float(run.left_m[place]), *in_kj))
    return rows
