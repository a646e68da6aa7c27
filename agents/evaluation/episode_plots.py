"""Plots of one episode of every agent, over time and over the route."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from homeward.agents.evaluation.episodes import TRACE_COLUMNS, Run
from homeward.agents.evaluation.plots import colour_of, png, tidy, title_of
from homeward.agents.evaluation.summary import Evaluation
from homeward.envs.missions import MISSIONS
from homeward.envs.options import known_of

_OUT = "#0072b2"
_HOME = "#d55e00"


def episode_png(evaluation: Evaluation) -> bytes:
    """One episode of every agent: energy, position, speed and sensing rate over time."""
    episode = typical_episode(evaluation)
    names = list(evaluation.runs)
    shared = known_of(evaluation.options).shared[0]
    figure, grid = _figure(names, height_ratios=(1.0, 1.5, 0.7, 0.7))
    for column, name in enumerate(names):
        run = evaluation.runs[name][0]
        axes = grid[:, column]
        trace = _trace(run, episode)
        hours = trace["time_s"] / 3600.0
        colour = colour_of(column)
        axes[0].plot(hours, 100.0 * trace["energy_share"], color=colour)
        axes[1].plot(hours, trace["position_m"], color=colour)
        # A value is that of the decision that ends there.
        axes[2].fill_between(
            hours, trace["speed_mps"], step="pre", color=colour, alpha=0.7, linewidth=0
        )
        axes[3].fill_between(
            hours, trace["sensing_hz"], step="pre", color=colour, alpha=0.7, linewidth=0
        )
        stands = np.flatnonzero(trace["speed_mps"][1:] == 0.0) + 1
        axes[1].plot(
            hours[stands],
            trace["position_m"][stands],
            marker="|",
            linestyle="",
            color="black",
            markersize=6,
        )
        end_marker = "o" if run.episodes.home[episode] else "X"
        axes[1].plot(hours[-1], trace["position_m"][-1], marker=end_marker, color=colour, markersize=7, clip_on=False,
                     zorder=4)  # fmt: skip
        axes[0].set_title(_heading(name, run, episode), fontsize=10)
        axes[3].set_xlabel("time, h")
    _shade_interest(grid[1], evaluation, episode, float(shared["length_m"]))
    highest_m = max(
        float(np.max(run.traces[:, episode, 2])) for run, *_ in evaluation.runs.values()
    )
    tops = {
        "state of charge, %": 104.0,
        "distance from home, m": 1.08 * highest_m,
        "speed, m/s": 1.1 * shared["max_speed_mps"],
        "sensing, Hz": 1.1 * shared["max_sensing_hz"],
    }
    for axis, (label, top) in zip(grid[:, 0], tops.items(), strict=True):
        axis.set_ylabel(label)
        axis.set_ylim(0.0, float(top))
        axis.set_xlim(left=0.0)
    tidy(*grid.flat)
    note = _shading_note(evaluation)
    figure.suptitle(f"{title_of(evaluation)}: episode {episode}{note}", fontsize=11)
    figure.supxlabel("strokes on the position: standing", fontsize=8, color="#888888")
    figure.align_ylabels(grid[:, 0])
    return png(figure)


def route_png(evaluation: Evaluation) -> bytes:
    """The same episode over the route: energy, speed, sensing rate and standing time by distance
    from home."""
    episode = typical_episode(evaluation)
    names = list(evaluation.runs)
    shared = known_of(evaluation.options).shared[0]
    length_m = float(shared["length_m"])
    borders_m = np.linspace(0.0, length_m, int(shared["places"]) + 1)
    figure, grid = _figure(names, height_ratios=(1.3, 1.0, 1.0, 0.8))
    furthest_m = 0.0
    for column, name in enumerate(names):
        run = evaluation.runs[name][0]
        axes = grid[:, column]
        trace = {
            quantity: values.astype(np.float64) for quantity, values in _trace(run, episode).items()
        }
        position_m = trace["position_m"]
        stands = trace["speed_mps"] == 0.0
        furthest_m = max(furthest_m, float(position_m.max()))
        turn = int(np.argmax(position_m))
        # The way home is drawn thinner, so that the way out is visible beside it where both are
        # equal.
        _draw_way(axes, trace, slice(None, turn + 1), colour=_OUT, label="out", width=3.0)
        _draw_way(axes, trace, slice(turn, None), colour=_HOME, label="home", width=1.3)
        durations_s = np.diff(trace["time_s"], prepend=0.0)
        minutes, _ = np.histogram(position_m[stands], borders_m, weights=durations_s[stands] / 60.0)
        axes[3].bar(borders_m[:-1], minutes, np.diff(borders_m), align="edge", color="#444444")
        axes[0].set_title(_heading(name, run, episode), fontsize=10)
        axes[3].set_xlabel("distance from home, m")
        _shade_places(axes, run.interest[episode], length_m, evaluation.options.mission)
    grid[0, 0].legend(fontsize=8, frameon=False)
    tops = {
        "state of charge, %": 104.0,
        "speed, m/s": 1.1 * float(shared["max_speed_mps"]),
        "sensing, Hz": 1.1 * float(shared["max_sensing_hz"]),
        "standing, min": None,  # as high as it gets
    }
    for axis, (label, top) in zip(grid[:, 0], tops.items(), strict=True):
        axis.set_ylabel(label)
        axis.set_ylim(0.0, top)
        axis.set_xlim(0.0, 1.03 * max(furthest_m, 1e-3 * length_m))
    tidy(*grid.flat)
    note = _shading_note(evaluation)
    figure.suptitle(f"{title_of(evaluation)}: episode {episode} over the route{note}", fontsize=11)
    figure.align_ylabels(grid[:, 0])
    return png(figure)


def _figure(names: Sequence[str], height_ratios: tuple[float, ...]) -> tuple[Figure, NDArray[Any]]:
    """A figure with a column of four axes for each agent, shape (4, agents)."""
    figure = Figure(figsize=(max(1.2 + 2.3 * len(names), 8.0), 7.0), layout="constrained")
    grid = figure.subplots(
        4, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=height_ratios
    )
    return figure, grid


def _trace(run: Run, episode: int) -> dict[str, NDArray[Any]]:
    """Columns of the trace of an episode, each of shape (decisions + 1,)."""
    decisions = int(run.episodes.decisions[episode])
    columns = run.traces[: decisions + 1, episode].T
    return dict(zip(TRACE_COLUMNS, columns, strict=True))


def _draw_way(
    axes: NDArray[Any],
    trace: dict[str, NDArray[Any]],
    part: slice,
    *,
    colour: str,
    label: str,
    width: float,
) -> None:
    """Draw energy, speed and sensing rate of a part of an episode over the position."""
    position_m = trace["position_m"][part]
    axes[0].plot(
        position_m, 100.0 * trace["energy_share"][part], color=colour, label=label, linewidth=width
    )
    moving = trace["speed_mps"][part] != 0.0
    moving[0] = True  # where the first decision begins
    for axis, quantity in ((axes[1], "speed_mps"), (axes[2], "sensing_hz")):
        values = trace[quantity][part]
        axis.plot(
            position_m[moving], values[moving], color=colour, drawstyle="steps", linewidth=width
        )


def _shading_note(evaluation: Evaluation) -> str:
    if MISSIONS[evaluation.options.mission].senses:
        return ", shaded by interest"
    return ""


def _heading(name: str, run: Run, episode: int) -> str:
    ending = "out of time"
    if run.episodes.home[episode]:
        ending = "home"
    elif run.episodes.stranded[episode]:
        ending = "stranded"
    return f"{name}\n{ending}, score {run.episodes.score[episode]:.4g}"


def _shade_places(
    axes: NDArray[Any], interest: NDArray[np.float32], length_m: float, mission: str
) -> None:
    if not MISSIONS[mission].senses:
        return
    for axis in axes[:3]:
        axis.imshow(
            interest[None], aspect="auto", cmap="Greys", alpha=0.55, vmin=0.0, vmax=1.5 * float(interest.max()),
            extent=(0.0, length_m, 0.0, 1.0), transform=axis.get_xaxis_transform(), zorder=0, interpolation="nearest",
        )  # fmt: skip


def typical_episode(evaluation: Evaluation) -> int:
    """Index of the episode, among those traced, in which the agents came closest to their median
    scores."""
    runs = [runs_of_agent[0] for runs_of_agent in evaluation.runs.values()]
    scores = np.array([run.episodes.score[: run.traces.shape[1]] for run in runs])
    medians = np.median(scores, axis=1, keepdims=True)
    spread = scores.std(axis=1, keepdims=True)
    distances = np.abs(scores - medians) / np.where(spread > 0.0, spread, 1.0)
    return int(np.argmin(distances.sum(axis=0)))


def _shade_interest(
    axes: NDArray[Any], evaluation: Evaluation, episode: int, length_m: float
) -> None:
    if not MISSIONS[evaluation.options.mission].senses:
        return
    runs: Sequence[Run] = next(iter(evaluation.runs.values()))
    interest = runs[0].interest[episode]  # all agents drive the same routes
    hours = max(float(run.traces[-1, episode, 0]) for run, *_ in evaluation.runs.values()) / 3600.0
    for axis in axes:
        axis.imshow(
            interest[:, None], origin="lower", aspect="auto", cmap="Greys", alpha=0.55, vmin=0.0,
            vmax=1.5 * float(interest.max()), extent=(0.0, hours * 1.03, 0.0, length_m), zorder=0,
            interpolation="nearest",
        )  # fmt: skip
