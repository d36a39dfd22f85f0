"""The compiled loop of the estimation-exploration algorithm (Section 3.3.3); see `teacher_modelling`.

All randomness is drawn beforehand (`Draws`) and all sums are integers: the result is a function of the draws,
bit for bit. For every buffered pixel the coverage by each part of each model is kept, so a mutation costs
only the rows of the parts that it touches, and a new pixel costs one ray test a part.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.vision._jit import compiled
from testbed.vision.kernel import cover

CUBOID, SPHERE = 0, 1
WHITE = 255


class View(NamedTuple):
    """What the student sees now, one entry a pixel, rows joined."""

    images: NDArray[np.uint8]  # (2, pixels)
    dx: NDArray[np.float32]  # (pixels,)
    dy: NDArray[np.float32]  # (pixels,)
    eyes: tuple[float, float]


class Memory(NamedTuple):
    """The training buffer, and what the two models make of it."""

    dx: NDArray[np.float32]  # (2, slots)
    dy: NDArray[np.float32]  # (2, slots)
    if_white: NDArray[np.int32]  # (2, slots): the squared error of the slot if the model leaves it white
    if_dark: NDArray[np.int32]  # (2, slots): ... less that, if the model darkens it
    rows: NDArray[np.uint8]  # (2, 2, k, slots): model, camera, part: covered or not
    sums: NDArray[np.int64]  # (2, 2): model, camera: the sums of squares of Eq. 4


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


class Trace(NamedTuple):
    """What a block of passes leaves behind."""

    history: NDArray[np.float64]  # (passes * iterations, k, 8)
    error: NDArray[np.float64]  # (passes, 2 models)
    pixels: NDArray[np.int64]  # (passes, 2 cameras)
    disagreed: NDArray[np.bool_]  # (passes, 2 cameras)


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
def _mutate(
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


@compiled
def _squares(
    rows: NDArray[np.uint8],
    fresh: NDArray[np.uint8],
    touched: NDArray[np.bool_],
    if_white: NDArray[np.int32],
    if_dark: NDArray[np.int32],
) -> int:
    """The sum of squares of one camera over all slots, each part's coverage from ``fresh`` where touched."""
    dark = np.zeros(if_white.size, np.uint8)
    for k in range(touched.size):
        row = fresh[k] if touched[k] else rows[k]
        for i in range(dark.size):
            dark[i] |= row[i]
    total = 0
    for i in range(dark.size):
        total += if_white[i] + (if_dark[i] if dark[i] else 0)
    return total


@compiled
def _seen(
    model: NDArray[np.float64], eye: float, dx: NDArray[np.float32], dy: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """(K,): 1 where any part of the model is seen."""
    dark = np.zeros(dx.size, np.uint8)
    row = np.empty(dx.size, np.uint8)
    for k in range(model.shape[0]):
        cover(model[k], eye, dx, dy, row)
        for i in range(dark.size):
            dark[i] |= row[i]
    return dark


@compiled
def _explore(
    models: NDArray[np.float64],
    view: View,
    order: NDArray[np.int64],
    uniforms: NDArray[np.float64],
    chosen: NDArray[np.int64],
    disagreed: NDArray[np.bool_],
) -> None:
    """Eq. 3: in each camera the first candidate that the two models see differently; else the first.

    ``order`` holds all pixels; a partial shuffle leaves the candidates, without replacement, at its head.
    """
    count = uniforms.size
    dx = np.empty(count, np.float32)
    dy = np.empty(count, np.float32)
    for j in range(count):
        other = j + int(uniforms[j] * (order.size - j))
        order[j], order[other] = order[other], order[j]
        dx[j] = view.dx[order[j]]
        dy[j] = view.dy[order[j]]
    for camera in range(2):
        in_a = _seen(models[0], view.eyes[camera], dx, dy)
        in_b = _seen(models[1], view.eyes[camera], dx, dy)
        first = 0
        while first < count and in_a[first] == in_b[first]:
            first += 1
        disagreed[camera] = first < count
        chosen[camera] = order[first if first < count else 0]


@compiled
def _learn(
    models: NDArray[np.float64], view: View, memory: Memory, slot: int, chosen: NDArray[np.int64], dark: int
) -> None:
    """Write the chosen pixel of each camera into its slot, labelled from the current images."""
    for camera in range(2):
        pixel = chosen[camera]
        label = int(view.images[camera, pixel])
        memory.dx[camera, slot] = view.dx[pixel]
        memory.dy[camera, slot] = view.dy[pixel]
        new_white = (label - WHITE) ** 2
        new_dark = (label - dark) ** 2 - new_white
        ray = slice(slot, slot + 1)
        for m in range(2):
            rows = memory.rows[m, camera]
            seen_before = seen_now = False
            for k in range(models.shape[1]):
                seen_before |= rows[k, slot] != 0
                cover(
                    models[m, k],
                    view.eyes[camera],
                    memory.dx[camera, ray],
                    memory.dy[camera, ray],
                    rows[k, ray],
                )
                seen_now |= rows[k, slot] != 0
            memory.sums[m, camera] -= memory.if_white[camera, slot]
            memory.sums[m, camera] += new_white
            if seen_before:
                memory.sums[m, camera] -= memory.if_dark[camera, slot]
            if seen_now:
                memory.sums[m, camera] += new_dark
        memory.if_white[camera, slot] = new_white
        memory.if_dark[camera, slot] = new_dark


@compiled
def error_of(sums: NDArray[np.int64], count: int) -> float:
    """Eq. 4 as printed: the root of each camera's sum of squares, divided by the number of pixels."""
    return math.sqrt(sums[0]) / count + math.sqrt(sums[1]) / count


@compiled
def _copy(source: NDArray[np.float64], target: NDArray[np.float64]) -> None:
    # In loops, here and below: numba compiles an array assignment for seconds (its error message, mostly).
    for k in range(source.shape[0]):
        for column in range(source.shape[1]):
            target[k, column] = source[k, column]


@compiled
def _estimate(
    model: NDArray[np.float64],
    child: NDArray[np.float64],
    touched: NDArray[np.bool_],
    memory: Memory,
    rows: NDArray[np.uint8],
    sums: NDArray[np.int64],
    fresh: NDArray[np.uint8],
    filled: int,
    eyes: tuple[float, float],
) -> None:
    """Replace the model, its ``rows`` (2, k, slots) and its ``sums`` (2,) by the child's if Eq. 4 is lower."""
    parent = error_of(sums, filled)
    new = np.zeros(2, np.int64)
    for camera in range(2):
        # The left eye alone may already be worse than the parent's two.
        if error_of(new, filled) >= parent:
            return
        dx, dy = memory.dx[camera, :filled], memory.dy[camera, :filled]
        for k in range(touched.size):
            if touched[k]:
                cover(child[k], eyes[camera], dx, dy, fresh[camera, k, :filled])
        if_white, if_dark = memory.if_white[camera, :filled], memory.if_dark[camera, :filled]
        new[camera] = _squares(rows[camera], fresh[camera], touched, if_white, if_dark)
    if error_of(new, filled) >= parent:
        return
    _copy(child, model)
    for camera in range(2):
        sums[camera] = new[camera]
        for k in range(touched.size):
            if touched[k]:
                for i in range(filled):
                    rows[camera, k, i] = fresh[camera, k, i]


@compiled
def run_passes(
    start: int,
    models: NDArray[np.float64],
    view: View,
    memory: Memory,
    order: NDArray[np.int64],
    draws: Draws,
    rules: Rules,
    trace: Trace,
) -> None:
    """Passes ``start``, ``start`` + 1, ... on one image pair: one exploration and one estimation each.

    ``models`` (2, k, 8), ``memory`` and ``order`` are carried on in place; ``trace`` is filled.
    """
    slots = memory.dx.shape[1]
    passes, iterations = draws.counts.shape[:2]
    parts = models.shape[1]
    child = np.empty((parts, 8))
    touched = np.empty(parts, np.bool_)
    fresh = np.empty((2, parts, slots), np.uint8)
    for t in range(passes):
        _explore(models, view, order, draws.candidates[t], trace.pixels[t], trace.disagreed[t])
        _learn(models, view, memory, (start + t) % slots, trace.pixels[t], rules.luminosity)
        filled = min(start + t + 1, slots)
        for step in range(iterations):
            for m in range(2):
                _copy(models[m], child)
                _mutate(child, touched, draws, t, step, m, rules)
                rows, sums = memory.rows[m], memory.sums[m]
                _estimate(models[m], child, touched, memory, rows, sums, fresh, filled, view.eyes)
            better = 0 if error_of(memory.sums[0], filled) <= error_of(memory.sums[1], filled) else 1
            _copy(models[better], trace.history[t * iterations + step])
        for m in range(2):
            trace.error[t, m] = error_of(memory.sums[m], filled)
