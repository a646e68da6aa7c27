"""Dials: speed, power, sensing, memory and score, each with a bar up to its maximum or a good
value."""

from __future__ import annotations

from dataclasses import dataclass

from homeward import quantities
from homeward.envs.missions import MISSIONS
from homeward.envs.viewer import palette
from homeward.envs.viewer.canvas import Box, Canvas
from homeward.envs.viewer.palette import Colour
from homeward.envs.viewer.scene import Scene


@dataclass(frozen=True)
class Dial:
    """One quantity; `share` is the filled share of its bar, None without a bar."""

    label: str
    value: str
    unit: str
    note: str
    share: float | None
    colour: Colour


def dials_of(scene: Scene) -> list[Dial]:
    """The dials of a mission."""
    dials = [
        Dial(
            label="Speed",
            value=f"{scene.speed_mps:.2f}",
            unit="m/s",
            note=f"at most {scene.max_speed_mps:.2g} m/s",
            share=scene.speed_mps / scene.max_speed_mps,
            colour=palette.BLUE,
        ),
        Dial(
            label="Power",
            value=f"{scene.power_w:.3g}",
            unit="W",
            note=f"the meter reads {scene.read_w:.3g} W",
            share=None,
            colour=palette.AMBER,
        ),
        Dial(
            label="Sensing",
            value=f"{scene.sensing_hz:.3g}",
            unit="Hz",
            note=f"at most {scene.max_sensing_hz:.3g} Hz",
            share=scene.sensing_hz / scene.max_sensing_hz,
            colour=palette.VIOLET,
        ),
    ]
    if MISSIONS[scene.mission].senses:
        dials.append(_memory(scene))
    return [*dials, _score(scene)]


def draw_dial(canvas: Canvas, box: Box, dial: Dial) -> None:
    """Draw one dial."""
    left, top, width, height = box
    canvas.text((left + 12.0, top + 17.0), dial.label, 12, palette.MUTED)
    value_width = canvas.text((left + 12.0, top + 42.0), dial.value, 22, palette.INK, bold=True)
    canvas.text((left + 18.0 + value_width, top + 45.0), dial.unit, 13, palette.MUTED)
    if dial.share is not None:
        bar = width - 24.0
        filled = min(max(dial.share, 0.0), 1.0) * bar
        canvas.box((left + 12.0, top + 60.0, bar, 6.0), palette.GRID, radius=3.0)
        if filled > 0.0:
            canvas.box((left + 12.0, top + 60.0, max(filled, 6.0), 6.0), dial.colour, radius=3.0)
    canvas.text((left + 12.0, top + height - 13.0), dial.note, 11, palette.MUTED)


def _memory(scene: Scene) -> Dial:
    note = "radio silent"
    if scene.sending:
        note = "radio sending"
        if scene.speed_mps > 0.0:
            note += " while driving"
    colour = palette.VIOLET
    if scene.lost > 0.0:
        note = f"too full, lost: {quantities.count(scene.lost)}"
        colour = palette.RED
    return Dial(
        label="Memory",
        value=f"{100.0 * scene.memory:.0f}",
        unit="% full",
        note=note,
        share=scene.memory,
        colour=colour,
    )


def _score(scene: Scene) -> Dial:
    mission = MISSIONS[scene.mission]
    return Dial(
        label="Score" if scene.over else "Score, once home",
        value=quantities.count(scene.score),
        unit=mission.unit,
        note=mission.note(scene),
        share=scene.score / scene.good_score,
        colour=palette.DARK_GREEN,
    )
