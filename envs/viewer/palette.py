"""Colours of the viewer."""

from __future__ import annotations

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255. All are chosen by eye."""

BACKGROUND, PANEL, EDGE, GRID = (241, 243, 246), (255, 255, 255), (216, 222, 229), (231, 235, 240)  # boxes
INK, MUTED, FAINT = (31, 41, 55), (91, 103, 120), (165, 174, 186)  # text
SKY, GROUND, DRIVEN, ROUGH = (238, 245, 251), (214, 217, 209), (178, 193, 158), (150, 112, 77)  # the route
BLUE, GREEN, DARK_GREEN, AMBER, RED, VIOLET = (
    (0, 100, 165), (79, 176, 126), (30, 122, 82), (222, 143, 5), (200, 50, 40), (106, 81, 163),
)  # fmt: skip


def mix(colour: Colour, second_colour: Colour, share: float) -> Colour:
    """A colour between two, with a share of the second."""

    def between(start: int, end: int) -> int:
        return round(start + (end - start) * share)

    red, green, blue = map(between, colour, second_colour)
    return red, green, blue
