"""Compiled: a body's posture as spheres and a centre of mass, in the frame of its root."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.vision._jit import compiled

Indices = NDArray[np.int64]

CUBOID, BALL, CAPPED = 0, 1, 2
"""Kinds of parts: the first column of ``shapes``, followed by sizes; (radius, 0, 0); (radius, length, 0)."""


@compiled
def half_length(shape: Vector) -> float:
    """From the hinge that carries a part to its centre, m."""
    kind = int(shape[0])
    if kind == CUBOID:
        return float(0.5 * shape[1])
    return float(shape[1] if kind == BALL else 0.5 * shape[2])


@compiled
def place_hinge(shape: Vector, angle: float, along: float, height: float, mount: Vector) -> None:
    """Where a hinge sits on a part of this ``shape``: fills ``mount`` (5,); see ``Morphology.mount``."""
    c, s, kind = math.cos(angle), math.sin(angle), int(shape[0])
    if kind == CAPPED:
        mount[0], mount[1] = shape[2] * (along - 0.5), 0.0
    else:
        distance = shape[1]
        if kind == CUBOID:
            distance = min(0.5 * shape[1] / max(abs(c), 1e-12), 0.5 * shape[2] / max(abs(s), 1e-12))
        mount[0], mount[1] = distance * c, distance * s
    mount[2], mount[3], mount[4] = height, c, s


@compiled
def sphere_count(shapes: Vector) -> int:
    """How many spheres make the hull of these parts."""
    count = 0
    for part in range(len(shapes)):
        kind = int(shapes[part, 0])
        count += 8 if kind == CUBOID else (1 if kind == BALL else 2)
    return count


@compiled
def place_parts(
    parents: Indices,
    order: Indices,
    mounts: Vector,
    shapes: Vector,
    masses: Vector,
    angles: Vector,
    frames: Vector,
    spheres: Vector,
    centre: Vector,
) -> None:
    """Forward kinematics at joint ``angles``: where every part is, its spheres, and the centre of mass.

    Args:
        parents: (n,) the part on which limb i (part i + 1) hangs.
        order: (n,) the limbs, none before its parent.
        mounts: (n, 5) place of the hinge in the parent's frame (m), cosine and sine of the mounting angle.
        shapes: (n + 1, 4) kind and sizes of the parts.
        masses: (n + 1,) kg.
        angles: (n,) rad.
        frames: (n + 1, 12) out: rotation by rows, then the centre.
        spheres: (s, 4) out: centre and radius.
        centre: (3,) out.
    """
    for k in range(12):
        frames[0, k] = 0.0
    frames[0, 0] = frames[0, 4] = frames[0, 8] = 1.0
    for index in range(len(order)):
        limb = order[index]
        above, here = frames[parents[limb]], frames[limb + 1]
        mx, my, mz, ca, sa = mounts[limb]
        cj, sj = math.cos(angles[limb]), math.sin(angles[limb])
        kind = int(shapes[limb + 1, 0])
        half = (
            0.5 * shapes[limb + 1, 1]
            if kind == CUBOID
            else (shapes[limb + 1, 1] if kind == BALL else 0.5 * shapes[limb + 1, 2])
        )
        for row in range(3):
            r0, r1, r2 = above[3 * row], above[3 * row + 1], above[3 * row + 2]
            ax = r0 * ca + r1 * sa
            ay = r1 * ca - r0 * sa
            here[3 * row] = ax * cj - r2 * sj
            here[3 * row + 1] = ay
            here[3 * row + 2] = ax * sj + r2 * cj
            here[9 + row] = above[9 + row] + r0 * mx + r1 * my + r2 * mz + half * here[3 * row]
    total, cx, cy, cz, at = 0.0, 0.0, 0.0, 0.0, 0
    for part in range(len(shapes)):
        frame, mass, kind = frames[part], masses[part], int(shapes[part, 0])
        total += mass
        cx += mass * frame[9]
        cy += mass * frame[10]
        cz += mass * frame[11]
        if kind == CUBOID:
            for corner in range(8):
                x = shapes[part, 1] * (0.5 if corner & 1 else -0.5)
                y = shapes[part, 2] * (0.5 if corner & 2 else -0.5)
                z = shapes[part, 3] * (0.5 if corner & 4 else -0.5)
                for row in range(3):
                    spheres[at, row] = (
                        frame[9 + row] + frame[3 * row] * x + frame[3 * row + 1] * y + frame[3 * row + 2] * z
                    )
                spheres[at, 3] = 0.0
                at += 1
        else:
            ends = 1 if kind == BALL else 2
            for end in range(ends):
                x = 0.0 if kind == BALL else shapes[part, 2] * (0.5 if end else -0.5)
                for row in range(3):
                    spheres[at, row] = frame[9 + row] + frame[3 * row] * x
                spheres[at, 3] = shapes[part, 1]
                at += 1
    centre[0], centre[1], centre[2] = cx / total, cy / total, cz / total
