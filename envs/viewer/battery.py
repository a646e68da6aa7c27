"""The battery: energy used by cause, energy left, and the part of it that the way home consumes."""

from __future__ import annotations

from homeward import quantities
from homeward.envs.viewer import palette
from homeward.envs.viewer.canvas import Box, Canvas
from homeward.envs.viewer.palette import Colour, mix
from homeward.envs.viewer.scene import Scene

COLOURS: dict[str, Colour] = {
    "rolling": palette.BLUE,
    "climbing": (213, 94, 0),
    "air and wind": (86, 180, 233),
    "payload": (204, 121, 167),
    "drive losses": (136, 34, 85),
    "sensing": palette.VIOLET,
    "computer": palette.AMBER,
    "electronics": (120, 128, 140),
    "charger": (240, 228, 66),
    "battery losses": (68, 170, 153),
}
_HATCHED_GREEN = mix(palette.DARK_GREEN, palette.GREEN, 0.6)
_WORTH_SHOWING = 5e-4  # of a full battery; chosen: a tenth of a decision


def draw_battery(canvas: Canvas, box: Box, scene: Scene) -> None:
    """Draw the battery as a column, with a legend."""
    left, top, width, height = box
    canvas.text((left + 12.0, top + 18.0), "Battery", 13, bold=True)
    full = f"full: {quantities.energy(scene.full_j)}"
    canvas.text((left + width - 12.0, top + 18.0), full, 12, palette.MUTED, align="right")
    column = (left + 24.0, top + 46.0, 58.0, height - 62.0)
    shown = _shown(scene)
    _draw_column(canvas, column, scene, shown)
    _draw_legend(canvas, (left + 102.0, top + 40.0, width - 114.0, height - 52.0), scene, shown)


def _shown(scene: Scene) -> dict[str, float]:
    """Uses that are large enough to be shown, J."""
    return {
        name: used
        for name, used in scene.used_j.items()
        if abs(used) > _WORTH_SHOWING * scene.full_j
    }


def _draw_column(canvas: Canvas, box: Box, scene: Scene, shown: dict[str, float]) -> None:
    """Draw the battery: what is used by cause above what is left, of which a part is for the way
    home."""
    left, top, width, height = box
    canvas.box((left + 0.3 * width, top - 7.0, 0.4 * width, 9.0), palette.EDGE, radius=2.0)
    canvas.box((left - 3.0, top - 3.0, width + 6.0, height + 6.0), palette.EDGE, radius=5.0)
    canvas.box(box, palette.PANEL)

    def height_of(joules: float) -> float:
        return height * joules / scene.full_j

    bottom = top + height
    level = bottom - height_of(scene.left_j)
    canvas.box((left, level, width, height_of(scene.left_j)), palette.GREEN)
    home_height = height_of(min(scene.home_j, scene.left_j))
    for_home = (left, bottom - home_height, width, home_height)
    canvas.box(for_home, palette.DARK_GREEN)
    canvas.hatch(for_home, _HATCHED_GREEN, 8.0)
    positive = {name: used for name, used in shown.items() if used > 0.0}
    used_j = scene.full_j - scene.worn_j - scene.left_j
    # If a descent returned energy, the others share the rest.
    scale = 0.0
    if positive:
        scale = used_j / sum(positive.values())
    for name, used in positive.items():
        part = height_of(used * scale)
        canvas.box((left, level - part, width, part), COLOURS[name])
        level -= part
    if scene.worn_j > _WORTH_SHOWING * scene.full_j:
        worn = (left, top, width, height_of(scene.worn_j))
        canvas.box(worn, palette.GRID)
        canvas.hatch(worn, palette.FAINT)
    if scene.home_j > scene.left_j and not scene.over:
        y = max(bottom - height_of(scene.home_j), top)
        canvas.dashes((left - 4.0, y), (left + width + 4.0, y), palette.RED, 2.0)
    gauge = bottom - height_of(scene.gauge_j)
    pointer = [(left - 4.0, gauge), (left - 13.0, gauge - 5.0), (left - 13.0, gauge + 5.0)]
    canvas.polygon(pointer, palette.INK)


def _draw_legend(canvas: Canvas, box: Box, scene: Scene, shown: dict[str, float]) -> None:
    """Draw the energy of each use, what is left, and what of it the way home consumes."""
    left, top, width, height = box
    y = top + 6.0
    step = 18.0

    def row(
        name: str,
        joules: float,
        colour: Colour | None,
        bold: bool = False,
        hatched: Colour | None = None,
    ) -> None:
        nonlocal y
        swatch = (left, y - 5.5, 11.0, 11.0)
        if colour is not None:
            canvas.box(swatch, colour, radius=2.0)
        if hatched is not None:
            canvas.hatch(swatch, hatched, 5.0)
        text_colour = palette.INK if bold else palette.MUTED
        canvas.text((left + 18.0, y), name, 12, text_colour, bold=bold)
        percent = f"{100.0 * joules / scene.full_j:.1f} %".replace("-", "−")
        canvas.text((left + width, y), percent, 12, palette.INK, bold=bold, align="right")
        y += step

    if scene.worn_j > _WORTH_SHOWING * scene.full_j:
        row("worn, hidden", scene.worn_j, palette.GRID, hatched=palette.FAINT)
        y += 4.0
    for name, used in reversed(shown.items()):
        row(name, used, COLOURS[name])
    if not shown:
        canvas.text((left, y), "nothing used yet", 12, palette.FAINT)
        y += step
    y = max(y + 4.0, top + height - 5.4 * step)
    canvas.line([(left, y - 12.0), (left + width, y - 12.0)], palette.GRID)
    row("left", scene.left_j, None, bold=True)
    canvas.polygon([(left + 11.0, y), (left + 2.0, y - 5.0), (left + 2.0, y + 5.0)], palette.INK)
    row("gauge reads", scene.gauge_j, None)
    canvas.text((left, y), "by the robot's own model:", 11, palette.FAINT)
    y += step - 1.0
    row("way home", scene.home_j, palette.DARK_GREEN, hatched=_HATCHED_GREEN)
    if scene.margin_j >= 0.0:
        row("to spare", scene.margin_j, palette.GREEN)
    else:
        row("short of home", scene.margin_j, palette.RED)
