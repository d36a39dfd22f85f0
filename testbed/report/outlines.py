"""The outline of a teacher model's part (Eq. 2) as seen along the line of sight."""

from __future__ import annotations

import math

import numpy as np

from testbed.report.reading import Array
from testbed.vision.primitives import CAPPED_CYLINDER, CUBOID


def outline(part: Array, points: int = 24) -> Array:
    """(n, 3) the part's outline in the rig frame (m), in the plane of its centre; a cuboid's on its near face.

    Args:
        part: (8,) shape, x, y, z, omega, d1, d2, d3.
        points: How many a rounded end has.
    """
    shape, x, y, z, omega, d1, d2, d3 = (float(value) for value in part)
    along = np.array([math.cos(omega), math.sin(omega), 0.0])
    across = np.array([-math.sin(omega), math.cos(omega), 0.0])
    if shape == CUBOID:
        corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        offsets = np.array([d1 / 2 * i * along + d3 / 2 * j * across for i, j in corners])
        offsets[:, 2] -= d2 / 2
    else:
        half = d2 / 2 if shape == CAPPED_CYLINDER else 0.0
        turn = np.linspace(-math.pi / 2, math.pi / 2, points)
        right = np.stack([np.cos(turn), np.sin(turn)], axis=1) * d1 + [half, 0.0]
        rounded = np.concatenate([right, -right])
        offsets = rounded[:, :1] * along + rounded[:, 1:] * across
    return np.asarray(offsets + np.array([x, y, z]))
