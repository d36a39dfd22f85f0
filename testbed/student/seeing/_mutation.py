"""Mutation of a teacher model (Section 3.3.3, the estimation phase), compiled.

"The mutation is achieved by randomly selecting from one to five variables in the genome and perturbing their
values using a Gaussian distribution"; a variable may be hit twice; a shape is drawn anew, and the sizes are
altered with it "so that the visual impact on the new image is slight".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.vision._jit import compiled
from testbed.vision.primitives import CUBOID, SPHERE


class Draws(NamedTuple):
    """Every random number of a block of passes."""

    candidates: NDArray[np.float64]  # (passes, candidates) in [0, 1)
    counts: NDArray[np.int64]  # (passes, iterations, 2 models)
    variables: NDArray[np.int64]  # (passes, iterations, 2, most) in 0 .. 8k-1
    normals: NDArray[np.float64]  # (passes, iterations, 2, most)
    shapes: NDArray[np.int64]  # (passes, iterations, 2, most) in 0 .. 2


class Rules(NamedTuple):
    """The mutation widths and the bounds of a part."""

    luminosity: int
    widths: NDArray[np.float64]  # (8,)
    depth: tuple[float, float]  # m
    extent: tuple[float, float]  # m
    tangent: tuple[float, float]  # tangents of half the field of view, right and down
    girth: float  # how much of a radius becomes a cuboid's edge: 2, or 2 pi


@compiled
def change_shape(part: NDArray[np.float64], shape: int, girth: float) -> None:
    """Give the part (8,) a new shape, with the sizes altered so that its image changes little.

    The visible width and height (along the own axes) are carried over, or their product where the new shape is
    as wide as high. ``girth`` = 2: a round part of radius r is as wide as a cuboid of edge 2 r.
    """
    old = int(part[0])
    if old == shape:
        return
    if old == CUBOID:
        across, tall = part[5], part[7]
        part[5] = math.sqrt(across * tall) / girth
        if shape != SPHERE and across >= tall:
            part[5] = tall / girth
        part[6] = max(across - 2.0 * part[5], 0.0) if shape != SPHERE and across >= tall else 0.0
    elif shape == CUBOID:
        round_edge = girth * part[5]
        part[5] = round_edge if old == SPHERE else part[6] + 2.0 * part[5]
        part[6] = round_edge
        part[7] = round_edge
    elif shape == SPHERE:
        part[5] = 0.5 * math.sqrt((part[6] + 2.0 * part[5]) * 2.0 * part[5])
    else:
        part[6] = 0.0
    part[0] = shape


@compiled
def confine(part: NDArray[np.float64], rules: Rules) -> None:
    """Clip the part (8,): its depth, its centre into the field of view, its extents. Roll is free."""
    part[3] = min(max(part[3], rules.depth[0]), rules.depth[1])
    for axis in range(2):
        limit = part[3] * rules.tangent[axis]
        part[1 + axis] = min(max(part[1 + axis], -limit), limit)
    low, high = rules.extent
    cuboid = part[0] == CUBOID
    for column in range(5, 8):
        part[column] = min(max(part[column], low if cuboid else 0.0), high)
    if not cuboid:
        part[5] = min(max(part[5], 0.5 * low), 0.5 * high)


@compiled
def mutate(
    model: NDArray[np.float64],
    touched: NDArray[np.bool_],
    draws: Draws,
    t: int,
    step: int,
    m: int,
    rules: Rules,
) -> None:
    """Mutate one to five variables of the model (k, 8) in place, and note which parts that touched."""
    for k in range(touched.size):
        touched[k] = False
    for j in range(draws.counts[t, step, m]):
        k, column = divmod(draws.variables[t, step, m, j], 8)
        touched[k] = True
        if column == 0:
            change_shape(model[k], draws.shapes[t, step, m, j], rules.girth)
        else:
            model[k, column] += rules.widths[column] * draws.normals[t, step, m, j]
        confine(model[k], rules)  # at once: the next variable may be the shape, which reads the sizes
