"""The plot of `homeward routes`: elevation and interest along the way."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from homeward.envs.routes import Route

_MOST = 8
"""Maximum number of routes that can be distinguished in one plot. Chosen."""


def routes_picture(routes: Sequence[Route], title: str, suffix: str) -> bytes:
    """Profiles of routes, the first eight, and the interest along the first.

    Args:
        routes: At least one.
        title: Title of the plot.
        suffix: `.png`, `.svg` or `.pdf`.
    """
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1.0))
    for index, route in reversed(list(enumerate(routes[:_MOST]))):
        edges = np.arange(len(route.grade_rad) + 1) * route.place_m / 1000.0
        height = np.concatenate(([0.0], np.cumsum(np.sin(route.grade_rad)) * route.place_m))
        if len(routes) == 1:
            upper.fill_between(edges, height, min(height.min(), 0.0), color="#b2c19e")
        if index == 0:
            upper.plot(edges, height, color="#566547", linewidth=2.0)
        else:
            upper.plot(edges, height, color="#b0b6bd", linewidth=1.0)
    route = routes[0]
    edges = np.arange(len(route.grade_rad) + 1) * route.place_m / 1000.0
    lower.stairs(route.interest, edges, fill=True, color="#6a51a3", alpha=0.7)
    upper.set_ylabel("elevation above home, m")
    lower.set_ylabel("interest")
    lower.set_ylim(bottom=0.0)
    lower.set_xlabel("distance from home along the route, km")
    for axis in (upper, lower):
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.set_axisbelow(True)
        axis.margins(x=0.0)
    count_note = ""
    if len(routes) > 1:
        count_note = f", {min(len(routes), _MOST)} of {len(routes)}"
    figure.suptitle(f"{title}{count_note}", fontsize=11)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=suffix.removeprefix("."), dpi=150)
    return buffer.getvalue()
