"""Dials: speed, power, sensing, memory and score, each with a bar up to its maximum or a good value."""

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
    speed, sensing = scene.speed_mps / scene.max_speed_mps, scene.sensing_hz / scene.max_sensing_hz
    dials = [
        Dial("Speed", f"{scene.speed_mps:.2f}", "m/s", f"at most {scene.max_speed_mps:.2g} m/s", speed, palette.BLUE),
        Dial("Power", f"{scene.power_w:.3g}", "W", f"the meter reads {scene.read_w:.3g} W", None, palette.AMBER),
        Dial("Sensing", f"{scene.sensing_hz:.3g}", "Hz", f"at most {scene.max_sensing_hz:.3g} Hz", sensing,
             palette.VIOLET),
    ]  # fmt: skip
    if MISSIONS[scene.mission].senses:
        dials.append(_memory(scene))
    return [*dials, _score(scene)]


def draw_dial(canvas: Canvas, box: Box, dial: Dial) -> None:
    """Draw one dial."""
    left, top, width, height = box
    canvas.text((left + 12.0, top + 17.0), dial.label, 12, palette.MUTED)
    taken = canvas.text((left + 12.0, top + 42.0), dial.value, 22, palette.INK, bold=True)
    canvas.text((left + 18.0 + taken, top + 45.0), dial.unit, 13, palette.MUTED)
    if dial.share is not None:
        bar, filled = width - 24.0, min(max(dial.share, 0.0), 1.0) * (width - 24.0)
        canvas.box((left + 12.0, top + 60.0, bar, 6.0), palette.GRID, radius=3.0)
        if filled > 0.0:
            canvas.box((left + 12.0, top + 60.0, max(filled, 6.0), 6.0), dial.colour, radius=3.0)
    canvas.text((left + 12.0, top + height - 13.0), dial.note, 11, palette.MUTED)


def _memory(scene: Scene) -> Dial:
    note = f"radio sending{' while driving' if scene.speed_mps > 0.0 else ''}" if scene.sending else "radio silent"
    colour = palette.VIOLET
    if scene.lost > 0.0:
        note, colour = f"too full, lost: {quantities.count(scene.lost)}", palette.RED
    return Dial("Memory", f"{100.0 * scene.memory:.0f}", "% full", note, scene.memory, colour)


def _score(scene: Scene) -> Dial:
    mission, value = MISSIONS[scene.mission], quantities.count(scene.score)
    label = "Score" if scene.over else "Score, once home"
    share = scene.score / scene.good_score
    return Dial(label, value, mission.unit, mission.note(scene), share, palette.DARK_GREEN)
