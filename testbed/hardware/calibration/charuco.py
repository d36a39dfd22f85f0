"""The calibration board: a chessboard with a marker in every white square, so that a part of it is enough.

Board frame: origin in the outer corner of the first square, x along its columns, y down its rows, z away from whoever
looks at it; metres. Everything on the board is made of texels, ten to a square, so that drawing it, rendering it and
detecting it all start from the same exact table.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from testbed.bodies.morphology import Vector
from testbed.scenario.base import Spec, unit_field

TEXELS = 10
"""Of one square along each side: a marker of 4 x 4 bits and its rim are 6, the white around it 2 on either side. With
the usual 1 on either side markers come so near to the corners that 1% of these are found half a pixel off."""
RULER = 0.1
"""Length (m) of the check ruler beside the board."""

Image = NDArray[np.uint8]

_CLEAR = 0.5  # half a window over the diagonal distance from a corner to a marker: of .35, .5 and .7 the best
_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)


class CharucoSpec(Spec):
    """What is printed on the board."""

    columns: int = Field(9, ge=3, le=15, description="squares; as many as fit on A4 at a readable size")
    rows: int = Field(6, ge=3, le=15, description="squares; odd and even, so that it has a right way up")
    square: float = unit_field(
        0.028,
        "m",
        gt=0.005,
        le=0.2,
        description="a marker bit is 2.8 mm: 2.2 pixels at 0.7 m, the farthest use",
    )

    @property
    def marker(self) -> float:
        """Side of a marker, m."""
        return self.square * 6 / TEXELS

    @property
    def white_share(self) -> float:
        """How much of a square is white on either side of its marker."""
        return (TEXELS - 6) / 2 / TEXELS

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height of the board, m."""
        return self.columns * self.square, self.rows * self.square

    @property
    def corner_count(self) -> int:
        """How many corners can be found on it."""
        return (self.columns - 1) * (self.rows - 1)

    def printed(self, ruler: float) -> Self:
        """The board as a printer made it, whose check ruler is ``ruler`` metres long instead of 0.1."""
        return self.model_copy(update={"square": self.square * ruler / RULER})

    def corners(self) -> Vector:
        """(N, 3) inner corners by their number, in the board frame, m."""
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        flat = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
        return np.asarray(flat * self.square, dtype=np.float64)

    def texels(self) -> Image:
        """(rows * 8, columns * 8) the board, 0 black and 255 white."""
        size = (self.columns * TEXELS, self.rows * TEXELS)
        # Drawn ten times as fine, for OpenCV rounds where a texel is one pixel.
        fine = opencv_board(self).generateImage((size[0] * 10, size[1] * 10), marginSize=0)
        return np.ascontiguousarray(fine[5::10, 5::10])


@functools.lru_cache(maxsize=8)
def opencv_board(spec: CharucoSpec) -> cv2.aruco.CharucoBoard:
    """The board as OpenCV knows it."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return cv2.aruco.CharucoBoard((spec.columns, spec.rows), spec.square, spec.marker, dictionary)


@dataclass(frozen=True)
class BoardView:
    """What one image shows of the board.

    Attributes:
        ids: (N,) numbers of the corners found, ascending.
        points: (N, 2) where they are, in pixels; whole numbers are pixel centres.
    """

    ids: NDArray[np.int64]
    points: Vector

    def only(self, ids: NDArray[np.int64]) -> BoardView:
        """The same view with these corners only; all of them must be in it."""
        kept = np.isin(self.ids, ids)
        return BoardView(self.ids[kept], self.points[kept])


class BoardDetector:
    """Finds a board in images."""

    def __init__(self, spec: CharucoSpec) -> None:
        self.spec = spec
        # Distortion bends the lines between corners only a little over one marker: no calibration is needed here.
        self._detector = cv2.aruco.CharucoDetector(opencv_board(spec))

    def find(self, image: Image) -> BoardView | None:
        """The board in an image (H, W) or (H, W, 3), or None where fewer than four corners are seen."""
        points, ids, _, _ = self._detector.detectBoard(grey(image))
        if ids is None or len(ids) < 4:
            return None
        # Some versions add a middle axis: (N, 1, 2) and (N, 1).
        numbers = np.asarray(ids).reshape(-1).astype(np.int64)
        order = np.argsort(numbers)
        places = np.asarray(points, dtype=np.float32).reshape(-1, 2)[order]
        return BoardView(numbers[order], self._refined(grey(image), places))

    def _refined(self, image: Image, points: NDArray[np.float32]) -> Vector:
        """The corners once more, each from as large a window as has no part of a marker in it."""
        gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
        gaps[gaps == 0] = np.inf
        clear = _CLEAR * math.sqrt(2) * self.spec.white_share * gaps.min(axis=1)
        halves = np.clip(np.rint(clear), 2, 9).astype(int)
        refined = points.copy()
        for half in np.unique(halves):
            own = halves == half
            corners = points[own].reshape(-1, 1, 2).copy()
            found = cv2.cornerSubPix(image, corners, (int(half), int(half)), (-1, -1), _UNTIL)
            refined[own] = np.asarray(found).reshape(-1, 2)
        return refined.astype(np.float64)


def grey(image: Image) -> Image:
    """An image (H, W) or (H, W, 3; blue, green, red) as luminosity (H, W)."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
