"""The render modes of an environment: a picture as an array, a window, or a few lines of text."""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.batch import Batch
from homeward.envs.options import RenderModeError
from homeward.envs.state import MISSION_DTYPE
from homeward.envs.viewer.point_of_no_return import PointOfNoReturn
from homeward.envs.viewer.read_scene import scene_of
from homeward.envs.viewer.scene import Scene
from homeward.envs.viewer.text import describe
from homeward.installed import advice

MODES = ("human", "rgb_array", "ansi")
"""Values of `render_mode`, beside None."""
FRAMES_PER_S = 15
"""Frames per second, one a decision. Chosen: a mission takes a quarter of a minute."""


class Viewer:
    """Shows one mission of a batch, and stores its decisions as long as it lasts.

    Args:
        batch: The missions; they are only read.
        mode: `human`, `rgb_array` or `ansi`.
        index: Index of the mission.

    Raises:
        RenderModeError: The mode does not exist, or needs pygame, which is missing.
    """

    def __init__(self, batch: Batch, mode: str, index: int = 0) -> None:
        if mode not in MODES:
            raise RenderModeError(
                f"render_mode = {mode!r} is not allowed; choose from None, {', '.join(MODES)}"
            )
        if mode != "ansi" and importlib.util.find_spec("pygame") is None:
            raise RenderModeError(
                f"render_mode = {mode!r} needs pygame: {advice('view', 'pygame-ce')}"
            )
        self.mode = mode
        self._batch = batch
        self._index = index
        self._trail: list[bytes] = []
        self._point_of_no_return: PointOfNoReturn | None = None
        self._canvas: Any = None
        self._window: Any = None

    def begin(self) -> None:
        """Drop the last mission and store the start of the new one, after a reset."""
        self._trail.clear()
        self.note()

    def note(self) -> None:
        """Store the mission as it is now, after a decision; in mode `human` it is shown as well."""
        self._trail.append(self._batch.records[self._index : self._index + 1].tobytes())
        if self.mode == "human":
            self.render()

    def scene(self) -> Scene:
        """The present scene."""
        if self._point_of_no_return is None:
            self._point_of_no_return = PointOfNoReturn(self._batch.known)
        states = np.frombuffer(b"".join(self._trail), MISSION_DTYPE)
        return scene_of(self._batch, states, self._point_of_no_return, self._index)

    def render(self) -> NDArray[np.uint8] | str | None:
        """Show the mission as it is now.

        Returns:
            In mode `rgb_array` the picture, shape (540, 960, 3); in mode `ansi` lines of text; in
            mode `human` nothing: the picture is in a window, and the call takes as long as a frame
            lasts. Once a user has closed the window the mission continues without it.
        """
        if self.mode == "ansi":
            return describe(self.scene())
        from homeward.envs.viewer.canvas import Canvas
        from homeward.envs.viewer.picture import draw
        from homeward.envs.viewer.window import Screen

        if self._canvas is None:
            self._canvas = Canvas()
        if self.mode == "rgb_array":
            draw(self._canvas, self.scene())
            pixels: NDArray[np.uint8] = self._canvas.pixels()
            return pixels
        if self._window is None:
            self._window = Screen(FRAMES_PER_S)
        if self._window.is_open:
            draw(self._canvas, self.scene())
            self._window.show(self._canvas.shrunk())
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def __getstate__(self) -> dict[str, Any]:
        # Surfaces cannot be pickled; they are made anew.
        return self.__dict__ | {"_canvas": None, "_window": None}
