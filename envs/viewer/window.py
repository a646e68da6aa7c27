"""A window that shows pictures at a steady rate and can be paused."""

from __future__ import annotations

import pygame

from homeward.envs.viewer.canvas import HEIGHT, WIDTH

_TITLE = "homeward     space: pause   right: one decision   escape: close"


class Screen:
    """A window on the screen; space pauses it, the right arrow shows the next frame, escape closes
    it.

    Args:
        frames_per_s: Frames that it shows in a second at most.
    """

    def __init__(self, frames_per_s: int) -> None:
        self._frames_per_s = frames_per_s
        self._paused = False
        self.is_open = True
        pygame.display.init()
        pygame.display.set_caption(_TITLE)
        self._screen = pygame.display.set_mode((WIDTH, HEIGHT))
        self._clock = pygame.time.Clock()

    def show(self, picture: pygame.Surface) -> None:
        """Show a picture until the next is due, or, while paused, until a key is pressed."""
        self._screen.blit(picture, (0, 0))
        pygame.display.flip()
        self._clock.tick(self._frames_per_s)
        go_on = self._handle_events()
        while self._paused and self.is_open and not go_on:
            self._clock.tick(self._frames_per_s)
            go_on = self._handle_events()

    def close(self) -> None:
        """Close the window."""
        if self.is_open:
            self.is_open = False
            pygame.display.quit()

    def _handle_events(self) -> bool:
        """Handle the user's input; returns whether the next frame was requested."""
        go_on = False
        for event in pygame.event.get():
            key = None
            if event.type == pygame.KEYDOWN:
                key = event.key
            if event.type == pygame.QUIT or key == pygame.K_ESCAPE:
                self.close()
                break
            if key == pygame.K_SPACE:
                self._paused = not self._paused
            go_on |= key == pygame.K_RIGHT
        return go_on
