"""Articulated bodies, compiled: where their parts are, and how they are drawn into an image.

A body is a tree of parts. Its numbers are one vector x = (pose of a frame, sizes and place shared by all frames);
``Plan`` says which of them moves what.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.vision._jit import compiled
from testbed.vision._spans import CORNERS, add_outline, outline

ALONG, UP, TURN, LENGTH, THICKNESS = range(5)
SCALE, DEPTH, YAW = range(3)


class Plan(NamedTuple):
    """A body as arrays; k parts, each after the one that it hangs on.

    Attributes:
        shape: (k,) 0 cuboid, 1 sphere, 2 capped cylinder.
        parent: (k,) what a part hangs on, -1 for none: such a part is free in the plane of motion.
        size: (k, 3) as in Eq. 2 at scale one, m.
        place: (k, 3) where the hinge sits in the parent's frame at scale one, m.
        mount: (k,) mounting angle about the parent's own z, rad.
        where: (k, 5) where x holds place along the plane (m), place down (m), turn (rad; a hinge's angle), logarithm of
            the length factor and of the thickness factor; -1: nowhere, then it is zero.
        common: (3,) where x holds the logarithm of the scale, the depth (m) and the yaw of the plane (rad).
        facing: 1.0 or -1.0: whether own x axes of free parts at turn zero point to the rig's right or left.
    """

    shape: NDArray[np.int64]
    parent: NDArray[np.int64]
    size: NDArray[np.float64]
    place: NDArray[np.float64]
    mount: NDArray[np.float64]
    where: NDArray[np.int64]
    common: NDArray[np.int64]
    facing: float


class Eyes(NamedTuple):
    """What was seen and with which eyes.

    Attributes:
        alpha: (F, 2, height, width) darkness, 0 to 1; -1 where it is unknown, for somebody else stood there.
        blank: (F,) sum of the known alpha^2: what it costs to explain nothing.
        places: (2,) x of the eyes, m.
        camera: (3,) focal length and the image's middle, pixels.
    """

    alpha: NDArray[np.float32]
    blank: NDArray[np.float64]
    places: NDArray[np.float64]
    camera: NDArray[np.float64]


@compiled
def read(x: NDArray[np.float64], index: int) -> float:
    """A number of x, zero where there is none."""
    return x[index] if index >= 0 else 0.0


@compiled
def place_parts(
    plan: Plan,
    x: NDArray[np.float64],
    centre: NDArray[np.float64],
    axes: NDArray[np.float64],
    size: NDArray[np.float64],
) -> None:
    """Write where the parts are: centre (k, 3), axes (k, 3, 3; rows own x, y, z) and size (k, 3), rig frame, m."""
    scale = math.exp(read(x, plan.common[SCALE]))
    depth = read(x, plan.common[DEPTH])
    yaw = read(x, plan.common[YAW])
    ux, uz = math.cos(yaw), math.sin(yaw)
    for i in range(plan.shape.size):
        parent = plan.parent[i]
        long = math.exp(read(x, plan.where[i, LENGTH]))
        thick = math.exp(read(x, plan.where[i, THICKNESS]))
        turn = read(x, plan.where[i, TURN])
        if plan.shape[i] == 0:
            size[i, 0] = plan.size[i, 0] * scale * long
            size[i, 1] = plan.size[i, 1] * scale
            size[i, 2] = plan.size[i, 2] * scale * thick
        elif plan.shape[i] == 1:
            size[i, 0] = plan.size[i, 0] * scale * thick
            size[i, 1] = size[i, 2] = 0.0
        else:
            size[i, 0] = plan.size[i, 0] * scale * thick
            size[i, 1] = plan.size[i, 1] * scale * long
            size[i, 2] = 0.0
        c, s = math.cos(turn), math.sin(turn)
        if parent < 0:
            along = read(x, plan.where[i, ALONG])
            centre[i, 0] = along * ux
            centre[i, 1] = read(x, plan.where[i, UP])
            centre[i, 2] = depth + along * uz
            f = plan.facing
            axes[i, 0, 0], axes[i, 0, 1], axes[i, 0, 2] = f * c * ux, s, f * c * uz
            axes[i, 1, 0], axes[i, 1, 1], axes[i, 1, 2] = -f * uz, 0.0, f * ux
            axes[i, 2, 0], axes[i, 2, 1], axes[i, 2, 2] = f * s * ux, -c, f * s * uz
        else:
            stretch = math.exp(read(x, plan.where[parent, LENGTH]))
            rise = math.exp(read(x, plan.where[parent, THICKNESS]))
            px = plan.place[i, 0] * scale * stretch
            py = plan.place[i, 1] * scale
            pz = plan.place[i, 2] * scale * rise
            cm, sm = math.cos(plan.mount[i]), math.sin(plan.mount[i])
            half = 0.5 * (size[i, 1] if plan.shape[i] == 2 else 2.0 * size[i, 0])
            if plan.shape[i] == 0:
                half = 0.5 * size[i, 0]
            for d in range(3):
                xp, yp, zp = axes[parent, 0, d], axes[parent, 1, d], axes[parent, 2, d]
                xm = cm * xp + sm * yp
                axes[i, 0, d] = c * xm - s * zp
                axes[i, 1, d] = cm * yp - sm * xp
                axes[i, 2, d] = s * xm + c * zp
                centre[i, d] = centre[parent, d] + px * xp + py * yp + pz * zp + half * axes[i, 0, d]


class Desk(NamedTuple):
    """Work space of the renderer."""

    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    size: NDArray[np.float64]
    area: NDArray[np.float64]
    px: NDArray[np.float64]
    py: NDArray[np.float64]


@compiled
def desk_of(k: int, height: int, width: int) -> Desk:
    """A fresh work space for k parts."""
    return Desk(
        np.empty((k, 3)),
        np.empty((k, 3, 3)),
        np.empty((k, 3)),
        np.zeros((height, width + 2)),
        np.empty(CORNERS),
        np.empty(CORNERS),
    )


@compiled
def draw(
    plan: Plan,
    drawn: int,
    eyes: Eyes,
    frame: int,
    eye: int,
    desk: Desk,
    cover: NDArray[np.float64],
    rows: NDArray[np.int64],
    keep: bool,
) -> float:
    """Draw the parts whose bits are set in ``drawn`` as already placed; returns the change of the cost."""
    cost = 0.0
    for i in range(plan.shape.size):
        if (drawn >> i) & 1:
            n = outline(
                plan.shape[i],
                desk.centre[i],
                desk.axes[i],
                desk.size[i],
                eyes.places[eye],
                eyes.camera,
                desk.px,
                desk.py,
            )
            if n > 0:
                cost += add_outline(desk.px, desk.py, n, eyes.alpha[frame, eye], desk.area, cover, rows, keep)
    return cost


@compiled
def row_ends(height: int, width: int) -> NDArray[np.int64]:
    """(4, height) ends of rows when nothing is drawn yet; see ``add_outline``."""
    rows = np.empty((4, height), np.int64)
    for v in range(height):
        rows[0, v], rows[1, v], rows[2, v], rows[3, v] = 0, 0, width, -1
    return rows
