"""Learning curves of trained agents against the other agents of an evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from homeward.agents.evaluation.learning_curve import EvaluatedCurve, Point
from homeward.agents.evaluation.plots import colour_of, png, tidy, title_of, unit_of
from homeward.agents.evaluation.summary import Evaluation

LEGEND: dict[str, Any] = {
    "fontsize": "small",
    "loc": "center left",
    "bbox_to_anchor": (1.0, 0.5),
    "frameon": False,
}
"""Where the legend stands: beside the upper axes."""


def learning_axes(mission: str) -> tuple[Figure, Axes, Axes]:
    """A figure of training: score above stranding, over the decisions."""
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    above.set_ylabel(f"score ({unit_of(mission)})")
    below.set_ylabel("stranded, %")
    below.set_xlabel("decisions of training, millions")
    tidy(above, below)
    return figure, above, below


def learning_png(
    evaluation: Evaluation, summary: dict[str, Any], curves: Mapping[str, Sequence[EvaluatedCurve]]
) -> bytes:
    """Score and stranding rate over the decisions of training, and those of all agents, on the same
    missions.

    The curve of what a run keeps ends at the agent's own level, which is their mean if there are
    several runs.

    Args:
        evaluation: Evaluation of all agents.
        summary: Its summary.
        curves: Learning curve of each training seed on the missions of the evaluation, by agent.
    """
    figure, above, below = learning_axes(evaluation.options.mission)
    for row, name in enumerate(evaluation.runs):
        agent = summary["agents"][name]
        colour = colour_of(row)
        kept_label: str | None = f"{name}, kept"
        present_label: str | None = f"{name}, at that time"
        for curve in curves.get(name, ()):
            _draw(
                above,
                below,
                curve.best_so_far,
                colour=colour,
                label=kept_label,
                style="-",
                marker="o",
            )
            _draw(
                above,
                below,
                curve.present,
                colour=colour,
                label=present_label,
                style=":",
                marker="",
            )
            kept_label = present_label = None  # one entry of the legend for all training seeds
        above.axhline(agent["score_mean"], color=colour, linestyle="--", linewidth=1.0, label=name)
        below.axhline(100.0 * agent["stranded_rate"], color=colour, linestyle="--", linewidth=1.0)
    above.legend(**LEGEND)
    figure.suptitle(f"{title_of(evaluation)}: learning curve", fontsize=11)
    figure.supxlabel(
        f"all on the {len(evaluation.seeds)} missions of this evaluation; solid: what the run would keep if it ended "
        "there,\nchosen on other missions; dotted: the policy at that time; dashed: the agents of the table",
        fontsize=8,
    )
    return png(figure)


def _draw(
    above: Axes,
    below: Axes,
    points: Sequence[Point],
    *,
    colour: str,
    label: str | None,
    style: str,
    marker: str,
) -> None:
    millions = [point.steps / 1e6 for point in points]
    keywords: dict[str, Any] = {
        "color": colour, "linestyle": style, "marker": marker, "markersize": 3.0, "linewidth": 1.5
    }  # fmt: skip
    above.plot(millions, [point.score for point in points], label=label, **keywords)
    below.plot(millions, [100.0 * point.stranded_rate for point in points], **keywords)
