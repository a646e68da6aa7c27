"""One picture of a mission: heading, route, battery and dials."""

from __future__ import annotations

from homeward import quantities
from homeward.envs.missions import MISSIONS
from homeward.envs.viewer import palette
from homeward.envs.viewer.battery import draw_battery
from homeward.envs.viewer.canvas import WIDTH, Box, Canvas
from homeward.envs.viewer.dials import dials_of, draw_dial
from homeward.envs.viewer.palette import Colour
from homeward.envs.viewer.profile import draw_interest, draw_profile
from homeward.envs.viewer.scene import Scene

STATE_COLOURS: dict[str, Colour] = {
    "ready": palette.MUTED,
    "out": palette.BLUE,
    "back": palette.BLUE,
    "stopped": palette.AMBER,
    "pit stop": palette.AMBER,
    "returning": palette.DARK_GREEN,
    "home": palette.DARK_GREEN,
    "stranded": palette.RED,
    "out of time": palette.RED,
}

_MARGIN = 12.0  # around panels; this and the next in pixels, chosen by eye
_GAP = 8.0  # between panels
_TOP = 52.0  # y of the panels' top
_MIDDLE = 436.0  # y of the dials' top
_BOTTOM = 528.0  # y of the dials' bottom
_SPLIT = 676.0  # x between the route and the battery
_INTEREST_TOP = 330.0  # y of the panel of a survey's interest


def draw(canvas: Canvas, scene: Scene) -> None:
    """Draw a scene.

    Args:
        canvas: Drawn over.
        scene: What there is to see.
    """
    canvas.clear()
    _heading(canvas, scene)
    senses = MISSIONS[scene.mission].senses
    left_width = _SPLIT - _GAP - _MARGIN
    right_width = WIDTH - _MARGIN - _SPLIT
    foot = _INTEREST_TOP if senses else _MIDDLE
    profile = _panel(canvas, (_MARGIN, _TOP, left_width, foot - _GAP - _TOP))
    draw_profile(canvas, profile, scene, STATE_COLOURS[scene.state])
    if senses:
        interest = _panel(canvas, (_MARGIN, foot, left_width, _MIDDLE - _GAP - foot))
        draw_interest(canvas, interest, scene)
    battery = _panel(canvas, (_SPLIT, _TOP, right_width, _MIDDLE - _GAP - _TOP))
    draw_battery(canvas, battery, scene)
    dials = dials_of(scene)
    width = (WIDTH - 2.0 * _MARGIN - (len(dials) - 1) * _GAP) / len(dials)
    for index, dial in enumerate(dials):
        box = (_MARGIN + index * (width + _GAP), _MIDDLE, width, _BOTTOM - _MIDDLE)
        draw_dial(canvas, _panel(canvas, box), dial)


def _panel(canvas: Canvas, box: Box) -> Box:
    canvas.box(box, palette.PANEL, radius=6.0, edge=palette.EDGE)
    return box


def _heading(canvas: Canvas, scene: Scene) -> None:
    title = MISSIONS[scene.mission].title
    width = canvas.text((_MARGIN + 2.0, 27.0), title, 20, bold=True)
    canvas.text((_MARGIN + 14.0 + width, 29.0), scene.heading, 13, palette.MUTED)
    label = scene.state.upper()
    colour = STATE_COLOURS[scene.state]
    pill = canvas.width_of(label, 13, bold=True) + 26.0
    canvas.box((WIDTH - _MARGIN - pill, 13.0, pill, 28.0), colour, radius=14.0)
    canvas.text(
        (WIDTH - _MARGIN - pill / 2.0, 27.0), label, 13, palette.PANEL, bold=True, align="centre"
    )
    when = f"decision {scene.decision} of at most {scene.max_decisions}"
    right = WIDTH - _MARGIN - pill - 14.0
    right -= (
        canvas.text((right, 28.0), quantities.duration(scene.time_s), 15, bold=True, align="right")
        + 12.0
    )
    canvas.text((right, 29.0), when, 12, palette.MUTED, align="right")
