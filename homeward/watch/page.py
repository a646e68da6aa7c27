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
"""Bars of the histogram of the probability integral transform. Chosen: the interval leaves a half of the outer ones."""
_INK, _PREDICTED, _BAND = "#1f2933", "#0b7285", "rgba(11, 114, 133, 0.18)"


def watch_html(
    runs: Sequence[Watched], robot: Robot, dropped: Sequence[str] = (), notes: Sequence[tuple[str, str]] = ()
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


def verdict(whole: Row) -> str:
    """Conclusion from the row of all moments, in a sentence."""
    least, most = thresholds.CALIBRATED
    trust = "as often as it should" if least <= whole.covered <= most else (
        "too rarely: it is overconfident" if whole.covered < least else "too often: it could be narrower"
    )  # fmt: skip
    return (
        f"The 90 % interval contained the consumption of the rest at {100.0 * whole.covered:.0f} % of "
        f"{whole.moments} moments, {trust}. On average it was {abs(100.0 * whole.bias):.1f} % too "
        f"{'high' if whole.bias > 0.0 else 'low'}."
    )


def figure(runs: Sequence[Watched]) -> Markup:
    """Energy of the rest over the way left, predicted with its interval and as measured; a panel a run."""
    shown = list(runs[:MOST_RUNS])
    made = make_subplots(
        len(shown), 1, vertical_spacing=min(0.35 / max(len(shown), 1), 0.12),
        subplot_titles=[str(number) for number in range(1, len(shown) + 1)] if len(shown) > 1 else None,
    )  # fmt: skip
    for row, run in enumerate(shown, start=1):
        x = np.concatenate((run.left_m, run.left_m[::-1])).round(1)
        band = np.concatenate((run.high_j, run.low_j[::-1])) / 1000.0
        first = row == 1
        made.add_scatter(
            x=x, y=band.round(4), fill="toself", fillcolor=_BAND, mode="none", name="90 % interval", hoverinfo="skip",
            showlegend=first, legendgroup="band", row=row, col=1,
        )  # fmt: skip
        for name, values, colour in (("predicted", run.mean_j, _PREDICTED), ("what it consumed", run.took_j, _INK)):
            made.add_scatter(
                x=run.left_m.round(1), y=(values / 1000.0).round(4), mode="lines", name=name,
                line={"color": colour, "width": 1.6}, showlegend=first, legendgroup=name, row=row, col=1,
            )  # fmt: skip
        made.update_yaxes(title_text=_RESTS[run.unit], rangemode="tozero", fixedrange=True, row=row, col=1)
        made.update_xaxes(title_text="way left, m", autorange="reversed", fixedrange=True, row=row, col=1)
    made.update_annotations(x=0.0, xanchor="left")  # in the middle, they would touch the title of the axis above
    count_word = "run" if len(shown) == 1 else "runs"
    says = (
        f"{_RESTS[shown[0].unit]}, over the way left in m, of {len(shown)} {count_word}: predicted with its 90 % "
        "interval, and what it consumed. The table below has moments of each run, watch.csv has all."
    )
    return _image(made, 90 + 260 * len(shown), says)


def transforms_figure(runs: Sequence[Watched]) -> Markup:
    """Histogram of the probability integral transform over the moments of all runs."""
    values = np.concatenate([transforms_of(run) for run in runs])
    counts, edges = np.histogram(values, _BINS, (0.0, 1.0))
    shares = counts / len(values)
    middles = 0.5 * (edges[1:] + edges[:-1])
    made = go.Figure()
    made.add_bar(x=middles.round(3), y=(100.0 * shares).round(2), width=1.0 / _BINS, marker={"color": _PREDICTED})
    made.update_traces(marker_line={"color": "white", "width": 1})
    made.add_hline(100.0 / _BINS, line={"color": _INK, "width": 1.6, "dash": "dot"})
    made.update_xaxes(title_text="probability of a lower consumption, by the prediction", range=[0.0, 1.0])
    made.update_yaxes(title_text="moments, %", rangemode="tozero")
    said = ", ".join(f"{share:.0%}" for share in shares)
    says = (
        f"Share of {len(values)} moments in each tenth of the probability integral transform, from 0 to 1: {said}; "
        "10 % in each if calibrated."
    )
    return _image(made, 300, says)


def _image(made: go.Figure, height: int, says: str) -> Markup:
    """A figure of a height in pixels, with a text alternative."""
    made.update_layout(
        height=height, margin={"l": 60, "r": 15, "t": 30, "b": 45}, dragmode=False,
        legend={"orientation": "h", "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom"}, **PLAIN,
    )  # fmt: skip
    made.update_xaxes(fixedrange=True, **GRID).update_yaxes(fixedrange=True, **GRID)
    return described(made.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False}), says)


def moments(run: Watched) -> list[tuple[float, float, float, float, float]]:
    """Rows of a run's table: way left, m; predicted mean, ends of its interval, and measured value, kJ or kA s."""
    rows = np.unique(np.linspace(0, len(run.left_m) - 1, _ROWS).astype(int))
    columns = (run.mean_j, run.low_j, run.high_j, run.took_j)
    return [(float(run.left_m[i]), *(float(values[i]) / 1000.0 for values in columns)) for i in rows]  # type: ignore[misc]
