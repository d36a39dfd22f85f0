"""The student's two eyes: an ideal stereo pair of pinhole cameras with parallel axes (Section 3.3).

Rig frame: x right, y down, z forward (depth), origin at the midpoint between the cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class StereoRig:
    """Two parallel cameras, ``baseline`` metres apart (the paper: 10 cm), of 100 x 75 pixels each.

    ``field_of_view`` is horizontal and in radians. Raises ValueError for a rig that cannot see.
    """

    width: int = 100
    height: int = 75
    field_of_view: float = math.radians(50.0)
    baseline: float = 0.10

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"an image needs at least one pixel, not {self.width} x {self.height}")
        if not 0.0 < self.field_of_view < math.pi:
            raise ValueError(f"field_of_view must lie between 0 and pi radians, not {self.field_of_view}")
        if not (math.isfinite(self.baseline) and self.baseline >= 0.0):
            raise ValueError(f"baseline must be a length in metres, not {self.baseline}")

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.width / 2.0 / math.tan(self.field_of_view / 2.0)

    @property
    def eyes(self) -> tuple[float, float]:
        """The x coordinates (m) of the left and of the right camera."""
        return -self.baseline / 2.0, self.baseline / 2.0

    def rays(self) -> NDArray[np.float64]:
        """(height, width, 2): a pixel looks along (dx, dy, 1); the same in both cameras."""
        dx = (np.arange(self.width) + 0.5 - self.width / 2.0) / self.focal
        dy = (np.arange(self.height) + 0.5 - self.height / 2.0) / self.focal
        return np.stack(np.meshgrid(dx, dy, indexing="xy"), axis=-1)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where (N, 3) points (m, rig frame) appear: (2, N, 2) pixel coordinates (u, v), left then right.

        Whole numbers are pixel centres. A point that is not in front of the cameras gives NaN.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        depth = np.where(points[:, 2] > 0.0, points[:, 2], np.nan)
        v = self.focal * points[:, 1] / depth + self.height / 2.0 - 0.5
        u = [self.focal * (points[:, 0] - eye) / depth + self.width / 2.0 - 0.5 for eye in self.eyes]
        return np.stack([np.stack([column, v], axis=-1) for column in u])
