"""The same questions in NumPy, vectorised over the rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import Look, Model, Rays, shades
from testbed.vision import CAPPED_CYLINDER, CUBOID


def open_eye(rays: Rays, eye: float, dtype: type[np.floating] = np.float64) -> Look:
    x, y = np.ascontiguousarray(rays.T.astype(dtype))

    def look(model: Model) -> NDArray[np.uint8]:
        return shades(meets(model.astype(dtype, copy=False), float(eye), x, y))

    return look


def meets(model: Model, eye: float, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(K,): which rays (x, y, 1) from (eye, 0, 0) meet the model."""
    dark = np.zeros(len(x), bool)
    for shape, px, py, z, omega, d1, d2, d3 in model:
        c, s, cx = np.cos(omega), np.sin(omega), px - eye
        if shape == CUBOID:
            ox, oy, ax, ay = x * c + y * s, y * c - x * s, cx * c + py * s, py * c - cx * s
            enter, leave = max(z - d2 / 2, 0.0), z + d2 / 2
            with np.errstate(divide="ignore"):
                for origin, half, way in ((ax, d1 / 2, ox), (ay, d3 / 2, oy)):
                    near, far = (origin - half) / way, (origin + half) / way
                    enter = np.maximum(enter, np.minimum(near, far))
                    leave = np.minimum(leave, np.maximum(near, far))
            dark |= enter <= leave
            continue
        half = d2 / 2 if shape == CAPPED_CYLINDER else 0.0
        ax, ay, az, bz = y * z - py, cx - x * z, x * py - y * cx, x * s - y * c
        along = np.clip((ax * s - ay * c - az * bz) / (1 + bz * bz), -half, half)
        ax, ay, az = ax - along * s, ay + along * c, az + along * bz
        dark |= ax * ax + ay * ay + az * az <= d1 * d1 * (x * x + y * y + 1)
    return dark
