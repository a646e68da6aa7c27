"""Shapes and text in pixels of the picture, drawn at twice the size and shrunk, so that edges are
smooth."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it would print a line on import

import numpy as np
import pygame
from numpy.typing import NDArray

from homeward.envs.viewer import palette
from homeward.envs.viewer.palette import Colour

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, width and height."""

WIDTH = 960
HEIGHT = 540
"""Pixels of the picture: a quarter of Full HD, 16 to 9."""
_FINE = 2  # drawn pixels per pixel of the picture; chosen: edges look smooth


class Canvas:
    """A picture of `WIDTH` by `HEIGHT` pixels."""

    def __init__(self) -> None:
        pygame.font.init()
        self._surface = pygame.Surface((WIDTH * _FINE, HEIGHT * _FINE), depth=32)
        self._fonts: dict[tuple[int, bool], pygame.font.Font] = {}

    def clear(self) -> None:
        """Begin a new picture."""
        self._surface.fill(palette.BACKGROUND)

    def shrunk(self) -> pygame.Surface:
        """The picture as a surface."""
        return pygame.transform.smoothscale(self._surface, (WIDTH, HEIGHT))

    def pixels(self) -> NDArray[np.uint8]:
        """The picture as an array of shape (HEIGHT, WIDTH, 3)."""
        pixels = np.frombuffer(pygame.image.tobytes(self.shrunk(), "RGB"), np.uint8)
        return pixels.reshape(HEIGHT, WIDTH, 3).copy()  # which may be written to

    def box(self, box: Box, fill: Colour, radius: float = 0.0, edge: Colour | None = None) -> None:
        """A rectangle."""
        area = pygame.Rect(*(round(_FINE * side) for side in box))
        pygame.draw.rect(self._surface, fill, area, border_radius=round(_FINE * radius))
        if edge is not None:
            pygame.draw.rect(
                self._surface, edge, area, width=_FINE, border_radius=round(_FINE * radius)
            )

    def polygon(self, points: Sequence[Point], fill: Colour) -> None:
        """A filled polygon."""
        pygame.draw.polygon(self._surface, fill, [self._fine(point) for point in points])

    def line(self, points: Sequence[Point], colour: Colour, width: float = 1.0) -> None:
        """A line through points, round at its corners."""
        fine = [self._fine(point) for point in points]
        thick = max(round(_FINE * width), 1)
        pygame.draw.lines(self._surface, colour, False, fine, thick)
        if thick > _FINE:
            for point in fine:
                pygame.draw.circle(self._surface, colour, point, thick / 2.0)

    def dashes(
        self, start: Point, end: Point, colour: Colour, width: float = 1.5, dash: float = 5.0
    ) -> None:
        """A dashed line."""
        x0, y0 = start
        x1, y1 = end
        length = float(np.hypot(x1 - x0, y1 - y0))
        for dash_start in np.arange(0.0, length, 2.0 * dash):
            from_share = dash_start / length
            to_share = min((dash_start + dash) / length, 1.0)
            dash_from = (x0 + from_share * (x1 - x0), y0 + from_share * (y1 - y0))
            dash_to = (x0 + to_share * (x1 - x0), y0 + to_share * (y1 - y0))
            self.line([dash_from, dash_to], colour, width)

    def circle(self, centre: Point, radius: float, fill: Colour) -> None:
        """A filled circle."""
        pygame.draw.circle(self._surface, fill, self._fine(centre), _FINE * radius)

    def arc(
        self,
        centre: Point,
        radius: float,
        start_deg: float,
        end_deg: float,
        colour: Colour,
        width: float,
    ) -> None:
        """An arc, counter-clockwise from the right."""
        x, y = centre
        angles = np.radians(np.linspace(start_deg, end_deg, 24))
        points = [
            (x + radius * float(np.cos(angle)), y - radius * float(np.sin(angle)))
            for angle in angles
        ]
        self.line(points, colour, width)

    def hatch(self, box: Box, colour: Colour, gap: float = 6.0) -> None:
        """Diagonal lines over a rectangle."""
        left, top, width, height = box
        clip = self._surface.get_clip()
        self._surface.set_clip(pygame.Rect(*(round(_FINE * side) for side in box)))
        for offset in np.arange(-height, width, gap):
            self.line([(left + offset, top + height), (left + offset + height, top)], colour, 1.0)
        self._surface.set_clip(clip)

    def text(
        self,
        anchor: Point,
        text: str,
        size: int = 12,
        colour: Colour = palette.INK,
        bold: bool = False,
        align: str = "left",
    ) -> float:
        """Text whose first, middle or last letter stands at a point, upright around it; returns its
        width."""
        image = self._font(size, bold).render(text, True, colour)
        width = image.get_width() / _FINE
        height = image.get_height() / _FINE
        x, y = anchor
        share_before = {"left": 0.0, "centre": 0.5, "right": 1.0}[align]
        self._surface.blit(image, self._fine((x - share_before * width, y - height / 2.0)))
        return width

    def width_of(self, text: str, size: int = 12, bold: bool = False) -> float:
        """Width that a text takes."""
        return self._font(size, bold).size(text)[0] / _FINE

    def _font(self, size: int, bold: bool) -> pygame.font.Font:
        if (size, bold) not in self._fonts:
            self._fonts[size, bold] = pygame.font.Font(str(_font_file(bold)), _FINE * size)
        return self._fonts[size, bold]

    def _fine(self, point: Point) -> tuple[int, int]:
        return round(_FINE * point[0]), round(_FINE * point[1])


def _font_file(bold: bool) -> Path:
    """DejaVu Sans, which comes with matplotlib; it is found without loading that."""
    spec = importlib.util.find_spec("matplotlib")
    assert spec is not None and spec.origin is not None  # a dependency
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / name
