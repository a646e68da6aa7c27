"""Score against stranding: each agent with several reserves, and all of them compared at equal
stranding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from homeward.agents.evaluation.episodes import Run
from homeward.agents.evaluation.plots import colour_of, png, tidy, unit_of

LEVELS = (0.001, 0.003, 0.01, 0.03)
"""Stranding rates at which agents are compared. Chosen: about equal steps of the logarithm, from
what 4,000 episodes can show up to what no user would accept."""


@dataclass(frozen=True)
class Curve:
    """Results of an agent with each of its reserves, or a single point if it has none.

    Attributes:
        reserve: The reserve, in the agent's own measure; None if it has none.
        score: Mean score, 0 unless home.
        stranded: Share of the missions that stranded.
    """

    reserve: tuple[float | None, ...]
    score: tuple[float, ...]
    stranded: tuple[float, ...]

    def at(self, level: float) -> float | None:
        """Best mean score at no more than a given stranding rate, interpolated linearly between two
        reserves.

        Returns:
            None if every reserve strands more.

        >>> Curve((1.0, 0.0), (10.0, 12.0), (0.0, 0.02)).at(0.01)
        11.0
        """
        # of equal stranding the best first
        order = np.lexsort((-np.array(self.score), np.array(self.stranded)))
        stranded = np.array(self.stranded)[order]
        # More stranding never has to score less: the reserve of a lower rate is allowed, too.
        best_score = np.maximum.accumulate(np.array(self.score)[order])
        if level < stranded[0]:
            return None
        below = int(np.searchsorted(stranded, level, side="right")) - 1
        above = min(below + 1, len(best_score) - 1)
        interpolated = np.interp(level, stranded, best_score)
        # Rounding may move it out of its interval.
        return float(np.clip(interpolated, best_score[below], best_score[above]))


def curve_of(runs: Mapping[float | None, Sequence[Run]]) -> Curve:
    """The curve of an agent from its runs by reserve, one per training seed."""
    scores = []
    stranded = []
    for seeds in runs.values():
        scores.append(float(np.mean([_mean_score(run) for run in seeds])))
        stranded.append(float(np.mean([run.episodes.stranded.mean() for run in seeds])))
    return Curve(reserve=tuple(runs), score=tuple(scores), stranded=tuple(stranded))


def _mean_score(run: Run) -> float:
    """Mean score of a run's episodes, 0 unless home."""
    scores = np.where(run.episodes.home, run.episodes.score, 0.0)
    return float(scores.mean())


def margins_png(curves: Mapping[str, Curve], mission: str, title: str) -> bytes:
    """Score against stranding of all agents, from least to most reserve."""
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.subplots()
    for index, (name, curve) in enumerate(curves.items()):
        axes.plot(
            100.0 * np.array(curve.stranded),
            curve.score,
            "o-",
            markersize=3.5,
            linewidth=1.2,
            color=colour_of(index),
            label=name,
        )
    axes.set_xscale("symlog", linthresh=0.1)
    axes.set_xlim(left=0.0)
    ticks = [0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xlabel("stranded, % of missions")
    axes.set_ylabel(f"mean score ({unit_of(mission)})")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8, frameon=False)
    tidy(axes)
    figure.suptitle(title, fontsize=11)
    return png(figure)
