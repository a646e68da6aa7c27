"""Plots of pages: their style, and how a page contains them."""

import plotly.graph_objects as go
from markupsafe import Markup

MOST_RUNS = 12
"""Of which a page has plots. Chosen: a page of a dozen plots loads at once."""

PLAIN = {
    "template": "plotly_white",
    "paper_bgcolor": "rgba(0, 0, 0, 0)",
    "plot_bgcolor": "rgba(0, 0, 0, 0)",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#1f2933"},
}
"""Layout of a figure in the font of its page, with a transparent background: pages are light or
dark."""
_LINE = "rgba(31, 41, 51, 0.2)"
GRID = {"gridcolor": _LINE, "zerolinecolor": _LINE}
"""Of each axis. Chosen: a contrast of 1.5 to 1 on light pages, of 1.7 on dark ones, where figures
are inverted."""


def embedded(figure: go.Figure, name: str, says: str, top: int = 8, zooms: bool = False) -> Markup:
    """A figure as a part of a page that has plotly.js in it already; one that `zooms` needs buttons
    for it, too.

    Who cannot see it hears what it `says`, and where the numbers are.
    """
    if not zooms:
        figure.update_xaxes(fixedrange=True).update_yaxes(fixedrange=True)
    figure.update_layout(
        margin={"l": 58, "r": 10, "t": top, "b": 46},
        dragmode="zoom" if zooms else False,
        hovermode="x unified",
        legend={
            "orientation": "h",
            "y": 1.06,
            "yanchor": "bottom",
            "x": 0.0,
            "traceorder": "normal",
        },
        **PLAIN,
    )
    figure.update_xaxes(**GRID).update_yaxes(**GRID)
    # The titles of panels are annotations.
    figure.update_annotations(x=0.0, xanchor="left", font={"size": 13})
    text = figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        div_id=f"figure-{name}",
        default_height="100%",
        config={"responsive": True, "displaylogo": False, "displayModeBar": False},
    )
    return described(text, says)


def described(plot: str, says: str) -> Markup:
    """A plot as one image with a text alternative (WAI-ARIA, role img)."""
    return Markup('<div role="img" aria-label="{}">{}</div>').format(says, Markup(plot))
