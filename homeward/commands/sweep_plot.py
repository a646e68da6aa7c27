"""Learning curves of the runs of a sweep, one colour for each settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from homeward.agents.evaluation.learning_curve import EPISODES, Point
from homeward.agents.evaluation.learning_plot import LEGEND, learning_axes
from homeward.agents.evaluation.plots import colour_of, png


def sweep_png(curves: Mapping[str, Sequence[Sequence[Point]]], env_id: str, mission: str) -> bytes:
    """Score and stranding rate over the decisions of training: a line for each seed.

    Args:
        curves: Learning curve of each seed, by settings.
        env_id: Environment.
        mission: Its mission, for the unit of the score.
    """
    figure, above, below = learning_axes(mission)
    figure.set_figwidth(8.0)  # names of settings are long
    for row, (settings, seeds) in enumerate(curves.items()):
        colour = colour_of(row)
        label: str | None = settings
        for points in seeds:
            millions = [point.steps / 1e6 for point in points]
            above.plot(
                millions,
                [point.score for point in points],
                color=colour,
                label=label,
                linewidth=1.2,
            )
            below.plot(
                millions,
                [100.0 * point.stranded_rate for point in points],
                color=colour,
                linewidth=1.2,
            )
            label = None  # one entry of the legend for all seeds
    above.legend(**LEGEND)
    figure.suptitle(f"{env_id}: a line for each training seed, on {EPISODES} missions", fontsize=11)
    return png(figure)
