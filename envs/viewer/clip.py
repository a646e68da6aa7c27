"""A clip of a mission as an animated GIF, without a video encoder."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from homeward.files import write_whole

_COLOURS = 128
"""Chosen: enough for the viewer's flat colours and the smooth edges of its letters."""


def write_gif(
    path: str | Path, frames: Sequence[NDArray[np.uint8]], frames_per_s: float = 15.0, width: int | None = None,
    hold_s: float = 2.0,
) -> None:  # fmt: skip
    """Write pictures as an animated GIF that repeats for ever.

    Args:
        path: Where to; its folder is made where it is missing.
        frames: Pictures of one size, uint8, shape (height, width, 3), at least one.
        frames_per_s: Pictures in a second; a GIF keeps time in hundredths of a second.
        width: Width to shrink to, pixels; none: as they are.
        hold_s: How long the last picture stays, s.

    Raises:
        OSError: The file cannot be written.
    """
    # One palette for all, or colours flicker: that of the first, middle and last picture together.
    # It covers small areas too, such as those of a legend.
    common = np.concatenate([frames[0], frames[len(frames) // 2], frames[-1]])
    palette = Image.fromarray(common).quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)
    pictures = [
        _shrunk(frame, width).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    each_ms = round(1000.0 / frames_per_s)
    durations: Any = [each_ms] * (len(pictures) - 1) + [max(round(1000.0 * hold_s), each_ms)]
    content = io.BytesIO()
    pictures[0].save(
        content,
        "GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=durations,
        loop=0,
        optimize=True,
    )
    write_whole(path, content.getvalue())


def _shrunk(frame: NDArray[np.uint8], width: int | None) -> Image.Image:
    picture = Image.fromarray(frame)
    if width is None:
        return picture
    return picture.resize(
        (width, round(width * picture.height / picture.width)), Image.Resampling.LANCZOS
    )
