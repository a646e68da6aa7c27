"""Pictures of an evaluation: scores and strandings of all agents, and one episode of each."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from homeward.agents.evaluation import TRACED, Evaluation, Run
from homeward.envs.options import settle

_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#666666")
"""Okabe and Ito's palette, told apart with any colour vision."""
_UNITS = {"OutAndBack": "furthest distance, m", "Survey": "information", "Patrol": "laps"}
_GREY = "#888888"


def scores_png(evaluation: Evaluation, summary: dict[str, Any]) -> bytes:
    """Scores with their means and intervals, and stranding rates, of all agents."""
    names = list(evaluation.runs)
    figure = Figure(figsize=(9.0, 1.6 + 0.55 * len(names)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(2.2, 1.0))
    jitter = np.random.default_rng(0)
    for row, name in enumerate(names):
        colour, one = _colour(row), summary["agents"][name]
        scores = evaluation.runs[name].episodes.score
        heights = row + jitter.uniform(-0.28, 0.28, len(scores))
        left.scatter(scores, heights, s=5, color=colour, alpha=0.25, linewidths=0, rasterized=True)
        _interval(left, one["score_mean"], one["score_ci95"], row, f"{one['score_mean']:.4g}")
        rate, interval = 100.0 * one["stranded_rate"], [100.0 * end for end in one["stranded_ci95"]]
        right.barh(row, rate, height=0.5, color=colour, alpha=0.6)
        _interval(right, rate, interval, row, f"{rate:.1f} %")
    left.set_yticks(range(len(names)), names)
    left.set_ylim(len(names) - 0.4, -0.6)
    left.set_xlim(left=min(0.0, left.get_xlim()[0]))
    right.set_xlim(0.0, 1.4 * max(5.0, *(100.0 * one["stranded_ci95"][1] for one in summary["agents"].values())))
    right.set_xticks([tick for tick in right.get_xticks() if tick <= 100.0])
    left.set_xlabel(f"score ({_UNITS[evaluation.options.mission]}), 0 unless home")
    right.set_xlabel("stranded, %")
    _tidy(left, right)
    figure.suptitle(f"{_title(evaluation)}: {len(evaluation.seeds)} episodes, seed {evaluation.seed}", fontsize=11)
    figure.supxlabel("a dot is an episode; crosses are means with 95 % intervals", fontsize=8, color=_GREY)
    return _png(figure)


def episode_png(evaluation: Evaluation) -> bytes:
    """One episode as every agent went through it: energy, position, speed and sensing rate over time."""
    episode = typical_episode(evaluation)
    names, setting = list(evaluation.runs), settle(evaluation.options)
    shared = setting.shared[0]
    figure = Figure(figsize=(max(1.2 + 2.3 * len(names), 8.0), 7.0), layout="constrained")
    grid = figure.subplots(4, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=(1.0, 1.5, 0.7, 0.7))
    for column, name in enumerate(names):
        run, axes = evaluation.runs[name], grid[:, column]
        decisions = int(run.episodes.decisions[episode])
        trace = dict(zip(TRACED, run.traces[: decisions + 1, episode].T, strict=True))
        hours, colour = trace["time_s"] / 3600.0, _colour(column)
        axes[0].plot(hours, 100.0 * trace["energy_share"], color=colour)
        axes[1].plot(hours, trace["position_m"], color=colour)
        # A value is that of the decision that ends there.
        axes[2].fill_between(hours, trace["speed_mps"], step="pre", color=colour, alpha=0.7, linewidth=0)
        axes[3].fill_between(hours, trace["sensing_hz"], step="pre", color=colour, alpha=0.7, linewidth=0)
        home = bool(run.episodes.home[episode])
        axes[1].plot(hours[-1], trace["position_m"][-1], marker="o" if home else "X", color=colour, markersize=7,
                     clip_on=False, zorder=4)  # fmt: skip
        ending = "home" if home else "stranded" if run.episodes.stranded[episode] else "out of time"
        axes[0].set_title(f"{name}\n{ending}, score {run.episodes.score[episode]:.4g}", fontsize=10)
        axes[3].set_xlabel("time, h")
    _shade_interest(grid[1], evaluation, episode, float(shared["length_m"]))
    highest_m = max(float(np.max(run.traces[:, episode, 2])) for run in evaluation.runs.values())
    for axis, label, top in zip(
        grid[:, 0],
        ("state of charge, %", "distance from home, m", "speed, m/s", "sensing, Hz"),
        (104.0, 1.08 * highest_m, 1.1 * shared["max_speed_mps"], 1.1 * shared["max_sensing_hz"]),
        strict=True,
    ):
        axis.set_ylabel(label)
        axis.set_ylim(0.0, float(top))
        axis.set_xlim(left=0.0)
    _tidy(*grid.flat)
    note = ", shaded where there is more to find" if evaluation.options.mission == "Survey" else ""
    figure.suptitle(f"{_title(evaluation)}: episode {episode}{note}", fontsize=11)
    figure.align_ylabels(grid[:, 0])
    return _png(figure)


def typical_episode(evaluation: Evaluation) -> int:
    """Index of the episode, among those traced, in which the agents came closest to their median scores."""
    runs = list(evaluation.runs.values())
    scores = np.array([run.episodes.score[: run.traces.shape[1]] for run in runs])
    spread = scores.std(axis=1, keepdims=True)
    distances = np.abs(scores - np.median(scores, axis=1, keepdims=True)) / np.where(spread > 0.0, spread, 1.0)
    return int(np.argmin(distances.sum(axis=0)))


def _shade_interest(axes: NDArray[Any], evaluation: Evaluation, episode: int, length_m: float) -> None:
    if evaluation.options.mission != "Survey":
        return
    first: Run = next(iter(evaluation.runs.values()))
    hours = max(float(run.traces[-1, episode, 0]) for run in evaluation.runs.values()) / 3600.0
    for axis in axes:
        axis.imshow(
            first.interest[episode][:, None], origin="lower", aspect="auto", cmap="Greys", alpha=0.55, vmin=0.0,
            vmax=1.5 * float(first.interest[episode].max()), extent=(0.0, hours * 1.03, 0.0, length_m), zorder=0,
            interpolation="nearest",
        )  # fmt: skip


def _interval(axis: Axes, middle: float, ends: list[float] | None, row: int, label: str) -> None:
    if ends is not None:
        axis.plot(ends, [row, row], color="black", linewidth=2.0, solid_capstyle="butt")
    axis.plot([middle, middle], [row - 0.17, row + 0.17], color="black", linewidth=2.0)
    anchor = middle if ends is None else ends[1]
    axis.annotate(
        label, (anchor, row), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9, zorder=5,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )  # fmt: skip


def _title(evaluation: Evaluation) -> str:
    options = evaluation.options
    return f"{evaluation.env}, {options.difficulty}, {options.robot}, route {options.route}"


def _colour(index: int) -> str:
    return _COLOURS[index % len(_COLOURS)]


def _tidy(*axes: Axes) -> None:
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.set_axisbelow(True)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
