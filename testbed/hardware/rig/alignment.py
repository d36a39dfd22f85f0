"""Whether what the two eyes see fits together, judged by the robots themselves, without a board.

The same robots stand in both pictures, in the same rows, and farther left in the right eye's. Where the rows differ the
cameras have been knocked; where they are farther right the cameras are exchanged. A knock that turns a camera to the
side looks like another distance: that only the board shows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from testbed.hardware.failures import CamerasSwapped, RigMoved

MOST_OFF_ROW = 2.0
"""Fine pixels, a third of the student's: three times the worst that rigs in order show, a knock of 0.2 degrees."""
IN_A_ROW = 4
"""So many pairs must agree: in one, a robot behind another may look like anything."""
_WIDEST = 200  # fine pixels of disparity: an arm's length away
_LEAST_DARK = 60.0  # fine pixels of full darkness in a picture, below which nothing can be told
_ALIKE = 0.93


@dataclass
class Alignment:
    """Watches pairs of cleaned pictures.

    Attributes:
        off_row: How many fine pixels lower the last usable pair's right picture was; None before.
        disparity: How many fine pixels farther left; likewise.
    """

    off_row: float | None = None
    disparity: float | None = None
    _moved: int = field(default=0, repr=False)
    _swapped: int = field(default=0, repr=False)

    def watch(self, left: NDArray[np.float32], right: NDArray[np.float32]) -> None:
        """Look at a cleaned pair, (450, 600) each, white where nothing stands.

        Raises:
            CamerasSwapped: If several pairs in a row show everything behind the eyes.
            RigMoved: If several pairs in a row show everything in other rows.
        """
        dark = [1 - image / np.float32(255) for image in (left, right)]
        if min(float(image.sum()) for image in dark) < _LEAST_DARK or any(map(_cut_off, dark)):
            return  # what is half outside one picture cannot be compared
        across = _shift(dark[0].sum(axis=0), dark[1].sum(axis=0), _WIDEST)
        down = _shift(dark[0].sum(axis=1), dark[1].sum(axis=1), _WIDEST // 4)
        if across is None or down is None:
            return
        self.disparity, self.off_row = across, -down
        self._swapped = self._swapped + 1 if across < -1 else 0
        self._moved = self._moved + 1 if abs(down) > MOST_OFF_ROW else 0
        if self._swapped >= IN_A_ROW:
            raise CamerasSwapped(
                f"robots are {-across:.0f} pixels farther right in the right camera's picture"
            )
        if self._moved >= IN_A_ROW:
            lower = "lower" if down < 0 else "higher"
            raise RigMoved(f"robots are {abs(down):.1f} pixels {lower} in the right camera's picture")


def _cut_off(dark: NDArray[np.float32]) -> bool:
    """Whether something touches a rim of the picture."""
    rims = (dark[:, :2], dark[:, -2:], dark[:2], dark[-2:])
    return any(float(rim.sum()) > 4 for rim in rims)


def _shift(left: NDArray[np.float32], right: NDArray[np.float32], most: int) -> float | None:
    """By how many places the left profile lies farther on than the right one; None if they are not alike."""
    similar = np.correlate(left, right, mode="full")
    middle = len(right) - 1
    window = similar[middle - most : middle + most + 1]
    best = int(np.argmax(window))
    norm = float(np.linalg.norm(left) * np.linalg.norm(right))
    if not 0 < best < len(window) - 1 or norm == 0 or window[best] < _ALIKE * norm:
        return None
    before, at, after = (float(value) for value in window[best - 1 : best + 2])
    curve = before - 2 * at + after
    return best - most + (0.5 * (before - after) / curve if curve else 0.0)
