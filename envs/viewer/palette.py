"""Colours of the viewer."""

from __future__ import annotations

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255. All are chosen by eye."""

# Boxes.
BACKGROUND = (241, 243, 246)
PANEL = (255, 255, 255)
EDGE = (216, 222, 229)
GRID = (231, 235, 240)
# Text.
INK = (31, 41, 55)
MUTED = (91, 103, 120)
FAINT = (165, 174, 186)
# The route.
SKY = (238, 245, 251)
GROUND = (214, 217, 209)
DRIVEN = (178, 193, 158)
ROUGH = (150, 112, 77)
# States and quantities.
BLUE = (0, 100, 165)
GREEN = (79, 176, 126)
DARK_GREEN = (30, 122, 82)
AMBER = (222, 143, 5)
RED = (200, 50, 40)
VIOLET = (106, 81, 163)


def mix(colour: Colour, second_colour: Colour, share: float) -> Colour:
    """A colour between two, with a share of the second."""

    def between(start: int, end: int) -> int:
        return round(start + (end - start) * share)

    red, green, blue = map(between, colour, second_colour)
    return red, green, blue
