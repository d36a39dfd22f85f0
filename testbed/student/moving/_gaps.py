"""Compiled: how far the rolls of a body that still moves are from those that are wanted (Eq. 5)."""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body._postures import Indices
from testbed.vision._jit import compiled

_SHORT = (
    1e-3  # a part that is seen shorter than this share of itself points at the viewer: its roll is anything
)
_EDGE = 1e-6  # rad: a roll this near to the end of its range may be read as the other end


@compiled
def gap(
    base: Vector, angles: Vector, tree: Indices, mounts: Vector, right: Vector, wanted: Vector, half: float
) -> float:
    """No more than the summed squared differences of rolls, rad2, at one moment.

    What rounding could make anything of is left out, so that the sum is never larger than another way to compute it.

    Args:
        base: (7,) position and quaternion xyzw of the root.
        angles: (n,) joint angles, rad.
        tree: (n, 3) from the root outward: a joint, the part that carries it, the part that it carries.
        mounts: (n, 3, 3) of each joint, on the part that carries it.
        right: (3,) the world direction that is to the right.
        wanted: (n + 1,) rolls of the parts; the first is the root.
        half: Rolls are read within so far of zero, rad: pi or half of it.
    """
    frames = np.empty((len(wanted), 3, 3))
    x, y, z, w = base[3], base[4], base[5], base[6]
    scale = 2 / (x * x + y * y + z * z + w * w)
    # One by one: numba compiles an array assignment for a second (its error message, mostly).
    root = frames[0]
    root[0, 0] = 1 - scale * (y * y + z * z)
    root[0, 1] = scale * (x * y - z * w)
    root[0, 2] = scale * (x * z + y * w)
    root[1, 0] = scale * (x * y + z * w)
    root[1, 1] = 1 - scale * (x * x + z * z)
    root[1, 2] = scale * (y * z - x * w)
    root[2, 0] = scale * (x * z - y * w)
    root[2, 1] = scale * (y * z + x * w)
    root[2, 2] = 1 - scale * (x * x + y * y)
    for row in range(len(tree)):
        joint, parent, child = tree[row]
        cosine, sine = math.cos(angles[joint]), math.sin(angles[joint])
        for i in range(3):
            ahead, up = 0.0, 0.0
            aside = 0.0
            for j in range(3):
                ahead += frames[parent, i, j] * mounts[joint, j, 0]
                aside += frames[parent, i, j] * mounts[joint, j, 1]
                up += frames[parent, i, j] * mounts[joint, j, 2]
            frames[child, i, 0] = cosine * ahead - sine * up
            frames[child, i, 1] = aside
            frames[child, i, 2] = sine * ahead + cosine * up
    total = 0.0
    for part in range(len(wanted)):
        across = frames[part, 0, 0] * right[0] + frames[part, 1, 0] * right[1] + frames[part, 2, 0] * right[2]
        down = -frames[part, 2, 0]
        roll = (math.atan2(down, across) + half) % (2 * half) - half
        if math.hypot(across, down) > _SHORT and abs(roll) < half - _EDGE:
            off = wanted[part] - roll
            total += off * off
    return total
