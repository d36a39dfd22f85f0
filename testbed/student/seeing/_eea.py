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

from testbed.student.seeing._mutation import Draws, Rules, mutate
from testbed.vision._jit import compiled
from testbed.vision.kernel import cover

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


class Trace(NamedTuple):
    """What a block of passes leaves behind."""

    histories: NDArray[np.float64]  # (passes * iterations, 2 models, k, 8)
    better: NDArray[np.uint8]  # (passes * iterations,): which of the two has the lower error
    error: NDArray[np.float64]  # (passes, 2 models)
    pixels: NDArray[np.int64]  # (passes, 2 cameras)
    disagreed: NDArray[np.bool_]  # (passes, 2 cameras)


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
        new_white = (label - WHITE) * (label - WHITE)
        new_dark = (label - dark) * (label - dark) - new_white
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
                mutate(child, touched, draws, t, step, m, rules)
                rows, sums = memory.rows[m], memory.sums[m]
                _estimate(models[m], child, touched, memory, rows, sums, fresh, filled, view.eyes)
            now = t * iterations + step
            for m in range(2):
                _copy(models[m], trace.histories[now, m])
            a_is_better = error_of(memory.sums[0], filled) <= error_of(memory.sums[1], filled)
            trace.better[now] = 0 if a_is_better else 1
        for m in range(2):
            trace.error[t, m] = error_of(memory.sums[m], filled)
