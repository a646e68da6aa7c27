"""Learning curves of trained agents against the other agents of an evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from homeward.agents.evaluation.learning_curve import EPISODES, Point
from homeward.agents.evaluation.plots import colour_of, png, tidy, title_of, unit_of
from homeward.agents.evaluation.summary import Evaluation


def learning_png(
    evaluation: Evaluation, summary: dict[str, Any], curves: Mapping[str, Sequence[Sequence[Point]]]
) -> bytes:
    """Score and stranding rate over the decisions of training, and those of the other agents.

    Args:
        evaluation: Evaluation of all agents.
        summary: Its summary.
        curves: Learning curve of each training seed, by agent.
    """
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    for row, name in enumerate(evaluation.runs):
        one, colour = summary["agents"][name], colour_of(row)
        for index, curve in enumerate(curves.get(name, ())):
            millions, label = [point.steps / 1e6 for point in curve], name if index == 0 else None
            style = {"color": colour, "marker": "o", "markersize": 3.0, "linewidth": 1.5}
            above.plot(millions, [point.score for point in curve], label=label, **style)
            below.plot(millions, [100.0 * point.stranded_rate for point in curve], **style)
        kept = f"{name}, the policy kept" if name in curves else name
        above.axhline(one["score_mean"], color=colour, linestyle="--", linewidth=1.0, label=kept)
        below.axhline(100.0 * one["stranded_rate"], color=colour, linestyle="--", linewidth=1.0)
    above.set_ylabel(f"score ({unit_of(evaluation.options.mission)})")
    below.set_ylabel("stranded, %")
    below.set_xlabel("decisions of training, millions")
    above.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    tidy(above, below)
    figure.suptitle(f"{title_of(evaluation)}: learning curve", fontsize=11)
    figure.supxlabel(
        f"curve: {EPISODES} missions of its own; dashed: the {len(evaluation.seeds)} of this evaluation", fontsize=8
    )
    return png(figure)
