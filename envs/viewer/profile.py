"""The route: hills, the robot on them, how far it may go, interest and information."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from homeward import quantities
from homeward.envs.missions import MISSIONS
from homeward.envs.viewer import palette
from homeward.envs.viewer.canvas import Box, Canvas, Point
from homeward.envs.viewer.palette import Colour, mix
from homeward.envs.viewer.scene import Scene

_LEFT = 54.0  # margins inside the panels, so that both share their horizontal axis; these by eye
_RIGHT = 20.0
_LIGHT_VIOLET = mix(palette.VIOLET, palette.PANEL, 0.72)
_APRON = 26.0
"""Flat ground before home and behind the end of the route, so that a robot there is fully
visible."""
_LOWLANDS = 0.68  # of the height of the picture for the hills; above them is room for text
_LEAST_WIND_MPS = 0.05  # a weaker wind is shown as none: it would round to 0.0
_FLATTEST = 0.02  # least height of the picture over its length, so that flat ground looks flat


def draw_profile(canvas: Canvas, box: Box, scene: Scene, colour: Colour) -> None:
    """Draw the hill profile with the robot on it."""
    left, top, width, height = box
    plot = (left + _LEFT, top + 32.0, width - _LEFT - _RIGHT, height - 32.0 - 30.0)
    canvas.text((left + 12.0, top + 18.0), "Route", 13, bold=True)
    canvas.text(
        (left + width - _RIGHT, top + 18.0), _weather(scene), 12, palette.MUTED, align="right"
    )
    canvas.box(plot, palette.SKY)
    to_x, to_y = _scales(plot, scene)
    _draw_axes(canvas, plot, scene, to_x, to_y)
    _draw_ground(canvas, plot, scene, to_x, to_y)
    foot = (to_x(scene.position_m), to_y(_elevation(scene, scene.position_m)))
    _draw_home(canvas, (to_x(0.0), to_y(0.0)))
    _draw_limit(canvas, plot, scene, to_x, to_y)
    _draw_robot(canvas, foot, _slope(scene, to_x, to_y), scene, colour)
    if scene.over:
        _draw_ending(canvas, plot, scene, colour)


def draw_interest(canvas: Canvas, box: Box, scene: Scene) -> None:
    """Draw the interest along the route, and how much of it was found."""
    left, top, width, height = box
    plot = (left + _LEFT, top + 32.0, width - _LEFT - _RIGHT, height - 32.0 - 10.0)
    canvas.text((left + 12.0, top + 18.0), "Information", 13, bold=True)
    x = left + width - _RIGHT
    for label, colour in (("gathered", palette.VIOLET), ("to be found per metre", _LIGHT_VIOLET)):
        x -= canvas.text((x, top + 18.0), label, 12, palette.MUTED, align="right") + 16.0
        canvas.box((x, top + 12.5, 11.0, 11.0), colour, radius=2.0)
        x -= 14.0
    to_x, _ = _scales(plot, scene)
    bottom = plot[1] + plot[3]
    scale = plot[3] / max(float(scene.interest.max()), 1e-9)

    def bar(start_m: float, end_m: float, bar_height: float, colour: Colour) -> None:
        x = to_x(start_m)
        # Half a pixel wider, so that neighbours touch.
        canvas.box((x, bottom - bar_height, to_x(end_m) - x + 0.5, bar_height), colour)

    for k, interest in enumerate(scene.interest):
        bar(scene.edges_m[k], scene.edges_m[k + 1], scale * interest, _LIGHT_VIOLET)
    for start_m, end_m, share in scene.sensed:
        for k in range(*_places(scene, start_m, end_m)):
            gathered_from_m = max(start_m, scene.edges_m[k])
            gathered_to_m = min(end_m, scene.edges_m[k + 1])
            gathered = scale * share * float(scene.interest[k])
            bar(gathered_from_m, gathered_to_m, gathered, palette.VIOLET)
    canvas.line([(plot[0], bottom), (plot[0] + plot[2], bottom)], palette.FAINT)
    x = to_x(scene.position_m)
    canvas.line([(x, plot[1]), (x, bottom)], palette.INK, 1.5)
    if scene.no_return_m is not None:
        x = to_x(scene.no_return_m)
        canvas.dashes((x, plot[1]), (x, bottom), palette.RED, 1.5)
    highest = f"{scene.interest.max():.1f}"
    canvas.text((plot[0] - 8.0, plot[1] + 5.0), highest, 11, palette.MUTED, align="right")
    canvas.text((plot[0] - 8.0, bottom - 4.0), "0", 11, palette.MUTED, align="right")


def _places(scene: Scene, start_m: float, end_m: float) -> tuple[int, int]:
    """Number of the first place of a stretch, and of the place after its last."""
    place_m = scene.edges_m[1]
    start = int(start_m / place_m)
    end = min(int(np.ceil(end_m / place_m)), len(scene.interest))
    return start, end


def _weather(scene: Scene) -> str:
    wind = "no wind"
    if scene.headwind_mps >= _LEAST_WIND_MPS:
        wind = f"headwind {scene.headwind_mps:.1f} m/s"
    elif scene.headwind_mps <= -_LEAST_WIND_MPS:
        wind = f"tailwind {-scene.headwind_mps:.1f} m/s"
    return f"{wind}, {scene.temperature_c:.0f} °C".replace("-", "−")


def _scales(plot: Box, scene: Scene) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Horizontal place of a position on the route, and vertical place of an elevation, in the
    picture."""
    left, top, width, height = plot
    low_m = float(scene.elevation_m.min())
    high_m = float(scene.elevation_m.max())
    spread_m = max(high_m - low_m, _FLATTEST * scene.length_m)
    middle_m = 0.5 * (low_m + high_m)
    bottom = top + 0.88 * height
    per_m = (_LOWLANDS - 0.12) * height / spread_m

    def to_x(position_m: float) -> float:
        return left + _APRON + (width - 2.0 * _APRON) * position_m / scene.length_m

    def to_y(elevation_m: float) -> float:
        return bottom - per_m * (elevation_m - middle_m + 0.5 * spread_m)

    return to_x, to_y


def _elevation(scene: Scene, position_m: float) -> float:
    return float(np.interp(position_m, scene.edges_m, scene.elevation_m))


def _slope(scene: Scene, to_x: Callable[[float], float], to_y: Callable[[float], float]) -> float:
    """Angle of the ground under the robot as it is drawn, rad."""
    k = min(int(scene.position_m / scene.edges_m[1]), len(scene.interest) - 1)
    rise = to_y(scene.elevation_m[k]) - to_y(scene.elevation_m[k + 1])
    run = to_x(scene.edges_m[k + 1]) - to_x(scene.edges_m[k])
    return float(np.arctan2(rise, run))


def _draw_axes(
    canvas: Canvas,
    plot: Box,
    scene: Scene,
    to_x: Callable[[float], float],
    to_y: Callable[[float], float],
) -> None:
    left, top, width, height = plot
    bottom = top + height
    for metres in _ticks(0.0, scene.length_m, 7):
        x = to_x(metres)
        canvas.line([(x, top), (x, bottom)], palette.GRID)
        if metres == 0.0:
            label = "home"
        elif scene.length_m < 2000.0:
            label = f"{metres:g} m"
        else:
            label = f"{metres / 1000.0:g} km"
        canvas.text((x, bottom + 13.0), label, 11, palette.MUTED, align="centre")
    for metres in _ticks(float(scene.elevation_m.min()), float(scene.elevation_m.max()), 3):
        y = to_y(metres)
        canvas.line([(left, y), (left + width, y)], palette.GRID)
        canvas.text(
            (left - 8.0, y), f"{metres:g} m".replace("-", "−"), 11, palette.MUTED, align="right"
        )


def _ticks(low: float, high: float, count: int) -> list[float]:
    """Round numbers between two, about so many."""
    least_step = max(high - low, 1e-9) / count
    power = 10.0 ** np.floor(np.log10(least_step))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= least_step)
    lowest = int(np.ceil(low / step - 1e-9))
    highest = int(np.floor(high / step + 1e-9))
    return [float(f"{k * step:.6g}") for k in range(lowest, highest + 1)]


def _draw_ground(
    canvas: Canvas,
    plot: Box,
    scene: Scene,
    to_x: Callable[[float], float],
    to_y: Callable[[float], float],
) -> None:
    bottom = plot[1] + plot[3]

    def surface(start_m: float, end_m: float) -> list[Point]:
        inner_m = scene.edges_m[(scene.edges_m > start_m) & (scene.edges_m < end_m)]
        corners_m = (start_m, *inner_m.tolist(), end_m)
        return [(to_x(corner_m), to_y(_elevation(scene, corner_m))) for corner_m in corners_m]

    def fill_below(outline: list[Point], fill: Colour) -> None:
        left_x, _ = outline[0]
        right_x, _ = outline[-1]
        canvas.polygon([(left_x, bottom), *outline, (right_x, bottom)], fill)

    ground = surface(0.0, scene.length_m)
    _, home_y = ground[0]
    _, end_y = ground[-1]
    ground = [(plot[0], home_y), *ground, (plot[0] + plot[2], end_y)]
    fill_below(ground, palette.GROUND)
    if scene.furthest_m > 0.0:
        fill_below(surface(0.0, scene.furthest_m), palette.DRIVEN)
    canvas.line(ground, mix(palette.GROUND, palette.INK, 0.35), 1.5)
    for k in np.flatnonzero(scene.rough > 0.01):
        shade = mix(palette.GROUND, palette.ROUGH, min(0.3 + float(scene.rough[k]), 1.0))
        points = surface(scene.edges_m[k], scene.edges_m[k + 1])
        canvas.line([(x, y + 2.0) for x, y in points], shade, 5.0)
    if scene.rough.max() > 0.01:
        sample_stroke = [(plot[0] + 6.0, bottom - 9.0), (plot[0] + 24.0, bottom - 9.0)]
        canvas.line(sample_stroke, palette.ROUGH, 5.0)
        canvas.text(
            (plot[0] + 32.0, bottom - 9.5), "rough ground", 11, mix(palette.MUTED, palette.INK, 0.4)
        )


def _draw_home(canvas: Canvas, foot: Point) -> None:
    x, y = foot
    canvas.line([(x, y), (x, y - 30.0)], palette.INK, 1.5)
    canvas.polygon([(x, y - 30.0), (x + 15.0, y - 25.5), (x, y - 21.0)], palette.INK)


def _draw_limit(
    canvas: Canvas,
    plot: Box,
    scene: Scene,
    to_x: Callable[[float], float],
    to_y: Callable[[float], float],
) -> None:
    """Mark the point of no return, or on the way home where the battery will be empty."""
    if scene.runs_out_m is not None:
        limit_m = scene.runs_out_m
        words = "battery empty here, by its own model"
    elif scene.no_return_m is not None:
        limit_m = scene.no_return_m
        words = "point of no return"
    else:
        return
    x = to_x(limit_m)
    label = f"{words} {quantities.distance(limit_m)}"
    width = canvas.width_of(label, 12, bold=True) + 14.0
    leftmost = plot[0] + 4.0
    rightmost = plot[0] + plot[2] - width - 4.0
    left = min(max(x - 0.5 * width, leftmost), rightmost)
    canvas.dashes((x, plot[1] + 26.0), (x, to_y(_elevation(scene, limit_m))), palette.RED, 2.0)
    canvas.box((left, plot[1] + 6.0, width, 20.0), palette.RED, radius=4.0)
    canvas.text(
        (left + 0.5 * width, plot[1] + 16.0), label, 12, palette.PANEL, bold=True, align="centre"
    )


def _draw_robot(canvas: Canvas, foot: Point, slope: float, scene: Scene, colour: Colour) -> None:
    cosine = float(np.cos(slope))
    sine = float(np.sin(slope))
    facing = 1.0 if scene.direction >= 0.0 else -1.0

    foot_x, foot_y = foot

    def at(along: float, above: float) -> Point:
        along *= facing
        x = foot_x + along * cosine - above * sine
        y = foot_y - along * sine - above * cosine
        return x, y

    body = [(-13.0, 6.0), (13.0, 6.0), (13.0, 11.0), (9.0, 16.0), (-13.0, 16.0)]
    canvas.polygon([at(*point) for point in body], colour)
    canvas.line([at(-7.0, 16.0), at(-7.0, 23.0)], palette.INK, 1.5)
    canvas.circle(at(-7.0, 24.0), 2.2, palette.INK)
    for along in (-8.0, 8.0):
        canvas.circle(at(along, 5.0), 5.0, palette.INK)
        canvas.circle(at(along, 5.0), 2.0, palette.PANEL)
    if scene.sensing_hz > 0.0 and not scene.over:
        strength = scene.sensing_hz / scene.max_sensing_hz
        middle = np.degrees(slope)
        if facing < 0.0:
            middle = 180.0 + middle
        for ring in range(1 + round(3.0 * strength)):
            canvas.arc(
                at(12.0, 12.0), 8.0 + 5.0 * ring, middle - 38.0, middle + 38.0, palette.VIOLET, 1.8
            )
    if scene.sending and not scene.over:
        for ring in range(2):
            canvas.arc(at(-7.0, 24.0), 6.0 + 4.5 * ring, 50.0, 130.0, colour, 1.5)
    if scene.position_m > 0.0:
        label = quantities.distance(scene.position_m)
        canvas.text((foot_x, foot_y - 47.0), label, 12, colour, bold=True, align="centre")


def _draw_ending(canvas: Canvas, plot: Box, scene: Scene, colour: Colour) -> None:
    unit = MISSIONS[scene.mission].unit
    where = ""
    score = scene.score
    if scene.state != "home":
        where = f", {quantities.distance(scene.position_m)} from home"
        score = 0.0
    words = f"{scene.state.capitalize()}{where}: score {quantities.count(score)} {unit}".rstrip()
    width = canvas.width_of(words, 17, bold=True) + 40.0
    left = plot[0] + 0.5 * (plot[2] - width)
    canvas.box((left, plot[1] + 8.0, width, 36.0), colour, radius=18.0)
    canvas.text(
        (left + 0.5 * width, plot[1] + 26.0), words, 17, palette.PANEL, bold=True, align="centre"
    )
