"""Poses: (4, 4) matrices that shift and turn, and what a tilt sensor reads of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.parts import Vector


def translation(x: float, y: float, z: float) -> Vector:
    """A (4, 4) pose that only shifts."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def rotation_y(angle: float) -> Vector:
    """A (4, 4) pose that only turns about y: x turns toward -z, downward, for positive angles (rad)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])


def rotation_z(angle: float) -> Vector:
    """A (4, 4) pose that only turns about z, counter-clockwise seen from above, in rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def rotation_about(vector: Sequence[float]) -> Vector:
    """A (4, 4) pose that only turns about a vector (3,), by its length in rad."""
    angle = math.hypot(*vector)
    if angle == 0:
        return np.eye(4)
    x, y, z = (component / angle for component in vector)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    return pose


def tilt_of(quaternion: NDArray[np.floating]) -> Vector:
    """(2,) tilt (rad) of a body with this orientation (xyzw), as an accelerometer at rest reads it."""
    x, y, z, w = np.asarray(quaternion, dtype=float).tolist()
    up = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))  # world's up in the body's frame
    return np.array([math.atan2(up[1], up[2]), math.atan2(-up[0], math.hypot(up[1], up[2]))])
