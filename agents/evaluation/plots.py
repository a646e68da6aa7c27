"""Plots of an evaluation: scores and strandings of all agents, and their performance profiles."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.random import Generator
from scipy import stats

from homeward.agents.evaluation.statistics import Bootstrap
from homeward.agents.evaluation.summary import Evaluation
from homeward.envs.missions import MISSIONS

_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#666666")
"""Okabe and Ito's palette, distinguishable with any colour vision."""
_GREY = "#666666"
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""Golden ratio: its multiples modulo 1 are spread evenly, and neighbours lie far apart."""


def unit_of(mission: str) -> str:
    """What a mission's score measures, with its unit."""
    return MISSIONS[mission].scored


def scores_png(evaluation: Evaluation, summary: dict[str, Any]) -> bytes:
    """Scores with their means and intervals, and stranding rates, of all agents."""
    names = list(evaluation.runs)
    figure = Figure(figsize=(9.0, 1.6 + 0.55 * len(names)), layout="constrained")
    scores_axis, stranded_axis = figure.subplots(1, 2, sharey=True, width_ratios=(2.2, 1.0))
    scores_of = evaluation.scores()
    for row, name in enumerate(names):
        colour = colour_of(row)
        agent = summary["agents"][name]
        scores = scores_of[name].ravel()
        spread = _GOLDEN * stats.rankdata(scores, "ordinal") % 1.0
        heights = row + 0.56 * (spread - 0.5)
        scores_axis.scatter(
            scores, heights, s=5, color=colour, alpha=0.25, linewidths=0, rasterized=True
        )
        _interval(
            scores_axis, agent["score_mean"], agent["score_ci95"], row, f"{agent['score_mean']:.4g}"
        )
        rate = 100.0 * agent["stranded_rate"]
        interval = [100.0 * end for end in agent["stranded_ci95"]]
        stranded_axis.barh(row, rate, height=0.5, color=colour, alpha=0.6)
        _interval(stranded_axis, rate, interval, row, f"{rate:.1f} %")
    scores_axis.set_yticks(range(len(names)), names)
    scores_axis.set_ylim(len(names) - 0.4, -0.6)
    scores_axis.set_xlim(left=min(0.0, scores_axis.get_xlim()[0]))
    highest_rate = max(100.0 * agent["stranded_ci95"][1] for agent in summary["agents"].values())
    stranded_axis.set_xlim(0.0, 1.4 * max(5.0, highest_rate))
    stranded_axis.set_xticks([tick for tick in stranded_axis.get_xticks() if tick <= 100.0])
    scores_axis.set_xlabel(f"score ({unit_of(evaluation.options.mission)}), 0 unless home")
    stranded_axis.set_xlabel("stranded, %")
    tidy(scores_axis, stranded_axis)
    figure.suptitle(
        f"{title_of(evaluation)}: {len(evaluation.seeds)} episodes, seed {evaluation.seed}",
        fontsize=11,
    )
    figure.supxlabel(
        "a dot is an episode of a training seed; crosses are means with 95 % intervals",
        fontsize=8,
        color=_GREY,
    )
    return png(figure)


def profiles_png(evaluation: Evaluation, summary: dict[str, Any], rng: Generator) -> bytes:
    """Performance profiles, and the probability that each agent beats the first one on an episode.

    A copy of the generator draws the bands.
    """
    names = list(evaluation.runs)
    thresholds = evaluation.thresholds()
    several = len(names) > 1
    height = max(3.6, 1.6 + 0.45 * len(names))
    if several:
        figure = Figure(figsize=(10.0, height), layout="constrained")
        axes = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    else:
        figure = Figure(figsize=(6.0, height), layout="constrained")
        axes = [figure.subplots()]
    drawn = Bootstrap(evaluation.scores(), rng, 999)
    for index, name in enumerate(names):
        axes[0].plot(
            thresholds, summary["profiles"][name], color=colour_of(index), label=name, linewidth=1.6
        )
        if len(evaluation.seeds) > 1:
            low, high = np.percentile(drawn.profiles(name, thresholds), [2.5, 97.5], axis=0)
            axes[0].fill_between(
                thresholds, low, high, color=colour_of(index), alpha=0.18, linewidth=0
            )
    axes[0].set_xlabel(f"score ({unit_of(evaluation.options.mission)})")
    axes[0].set_ylabel("share of episodes that score more")
    axes[0].set_ylim(0.0, 1.02)
    axes[0].set_xlim(0.0, float(thresholds[-1]) or 1.0)  # all scores may be 0
    axes[0].legend(fontsize=8, frameon=False)
    if several:
        for row, name in enumerate(names[1:]):
            pair = summary["paired"][f"{name} - {names[0]}"]
            value = pair["probability_of_improvement"]
            axes[1].barh(row, value, height=0.5, color=colour_of(row + 1), alpha=0.6)
            _interval(axes[1], value, pair["probability_ci95"], row, f"{value:.2f}")
        axes[1].axvline(0.5, color=_GREY, linewidth=1.0, linestyle="--")
        axes[1].set_yticks(range(len(names) - 1), names[1:])
        axes[1].set_ylim(len(names) - 1.4, -0.6)
        axes[1].set_xlim(0.0, 1.12)
        axes[1].set_xticks([0.0, 0.25, 0.5, 0.75, 1.0])
        axes[1].set_xlabel(f"probability of scoring more than {names[0]}")
    tidy(*axes)
    figure.suptitle(f"{title_of(evaluation)}: {len(evaluation.seeds)} episodes", fontsize=11)
    figure.supxlabel(
        "bands and lines: 95 % bootstrap intervals over episodes and training seeds",
        fontsize=8,
        color=_GREY,
    )
    return png(figure)


def _interval(axis: Axes, middle: float, ends: list[float] | None, row: int, label: str) -> None:
    anchor = middle
    if ends is not None:
        axis.plot(ends, [row, row], color="black", linewidth=2.0, solid_capstyle="butt")
        anchor = ends[1]
    axis.plot([middle, middle], [row - 0.17, row + 0.17], color="black", linewidth=2.0)
    axis.annotate(
        label, (anchor, row), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9, zorder=5,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )  # fmt: skip


def title_of(evaluation: Evaluation) -> str:
    """Environment and options of an evaluation."""
    options = evaluation.options
    return f"{evaluation.env}, {options.difficulty}, {options.robot}, route {options.route}"


def colour_of(index: int) -> str:
    """Colour of an agent by its index."""
    return _COLOURS[index % len(_COLOURS)]


def tidy(*axes: Axes) -> None:
    """Remove unnecessary lines."""
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.set_axisbelow(True)


def png(figure: Figure) -> bytes:
    """A figure as the bytes of a file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
