"""The plot of `homeward range`: range and energy per metre over the speed."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from homeward.commands.range_parts import Mission

_SPEEDS = 60  # points along the speed axis; chosen: the curve looks smooth
_COLOURS = (
    "#0072b2",
    "#56b4e9",
    "#d55e00",
    "#6a51a3",
    "#009e73",
    "#999999",
    "#e69f00",
    "#cc79a7",
    "#882255",
    "#44aa99",
)
"""Okabe and Ito's palette and some more."""


def range_picture(mission: Mission, speed_mps: float, suffix: str) -> bytes:
    """Range over the speed, and below it the energy per metre by part.

    Args:
        mission: The robot and how it drives.
        speed_mps: Speed to mark, m/s.
        suffix: `.png`, `.svg` or `.pdf`.
    """
    robot = mission.robot
    speeds = np.linspace(robot.min_speed_mps, max(robot.max_speed_mps, speed_mps), _SPEEDS)
    columns = [mission.parts_j_per_m(float(speed)) for speed in speeds]
    names = list(dict.fromkeys(name for column in columns for name in column))
    parts = np.array([[column.get(name, 0.0) for column in columns] for name in names])
    range_km = mission.range_m(speed_mps) / 1000.0
    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.3))
    upper.plot(speeds, [mission.range_m(float(speed)) / 1000.0 for speed in speeds], color="black")
    upper.plot([speed_mps], [range_km], "o", color="black")
    upper.annotate(
        f"{range_km:.2f} km at {speed_mps:.2f} m/s", (speed_mps, range_km), xytext=(-8, -14),
        textcoords="offset points", ha="right",
    )  # fmt: skip
    upper.set_ylabel("range, km")
    upper.set_ylim(bottom=0.0)
    # Downhill the grade supplies energy to the other parts: it is drawn below zero.
    gains = np.where(parts.min(axis=1, keepdims=True) < 0.0, parts, 0.0)
    _stack(lower, speeds, parts - gains, names)
    _stack(lower, speeds, gains, ())
    lower.axvline(speed_mps, color="black", linewidth=1.0, linestyle=":")
    lower.set_ylabel("energy per metre, J/m")
    lower.set_xlabel("speed while moving, m/s")
    handles, labels = lower.get_legend_handles_labels()
    # In the order of the layers, the topmost first.
    figure.legend(handles[::-1], labels[::-1], loc="outside right lower", frameon=False, fontsize=9)
    for axis in (upper, lower):
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.set_axisbelow(True)
    figure.suptitle(
        f"{robot.name}: grade {np.degrees(mission.grade_rad):g}°, moving {mission.duty:.1%} of the time, "
        f"sensing at {mission.sensing_hz:g} Hz", fontsize=11,
    )  # fmt: skip
    buffer = io.BytesIO()
    figure.savefig(buffer, format=suffix.removeprefix("."), dpi=150)
    return buffer.getvalue()


def _stack(
    axis: Axes, speeds: NDArray[np.float64], parts: NDArray[np.float64], names: Sequence[str]
) -> None:
    """Stack the parts that are not zero everywhere, shape (parts, speeds), each in its colour.

    Args:
        axis: Where to draw.
        speeds: Shape (speeds,).
        parts: Energy per metre, J/m.
        names: Labels of the parts; none if they have theirs already.
    """
    shown = [index for index in range(len(parts)) if parts[index].any()]
    if not shown:
        return
    colours = [_COLOURS[index % len(_COLOURS)] for index in shown]
    labels = [names[index] for index in shown if names]
    axis.stackplot(speeds, parts[shown], labels=labels, colors=colours)
