"""A window for people to watch the world in (``render_mode="human"``; needs the extra ``viewer``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.errors import UserError


class Viewer:
    """A window that shows one picture after the other.

    Raises:
        UserError: If pygame is not installed, or there is no display.
    """

    def __init__(self, title: str) -> None:
        try:
            import pygame
        except ImportError:
            raise UserError(
                "render_mode 'human' needs a window library",
                mend="install it: pip install 'whom-to-imitate[viewer]'",
            ) from None
        self._pygame = pygame
        self._title = title
        self._window: pygame.Surface | None = None
        try:
            pygame.display.init()
        except pygame.error as error:
            raise UserError(
                f"render_mode 'human' found no display ({error})", mend="use render_mode 'rgb_array'"
            ) from None

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a (height, width, 3) picture."""
        if self._window is None:
            self._window = self._pygame.display.set_mode(picture.shape[1::-1])
            self._pygame.display.set_caption(self._title)
        self._window.blit(self._pygame.surfarray.make_surface(picture.swapaxes(0, 1)), (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()
