"""Articulated bodies against stereo silhouettes, compiled: costs and their linearisation.

The cost of a frame is the sum over the known pixels of both eyes of (coverage - darkness)^2. Derivatives are forward
differences: coverage is exact area, so that they are smooth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.student.seeing._plan import LENGTH, TURN, Eyes, Plan, desk_of, draw, place_parts, read, row_ends
from testbed.vision._jit import compiled
from testbed.vision._spans import clear

_ROOM = 6000
"""Pixels of one frame that may change with the numbers of a body."""


def costs(
    plan: Plan, drawn: int, eyes: Eyes, frames: NDArray[np.int64], x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(B,) cost of each hypothesis: x (B, m) in frame ``frames`` (B,), with the parts of the bit set ``drawn``."""
    nothing = np.empty(0)
    return linearised(plan, drawn, eyes, frames, x, nothing.astype(np.int64), nothing)[0]


@compiled
def fan_costs(
    plan: Plan,
    drawn: int,
    limb: int,
    eyes: Eyes,
    frames: NDArray[np.int64],
    x: NDArray[np.float64],
    turns: NDArray[np.float64],
    lengths: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(B, A) cost of each hypothesis x (B, m) with the parts ``drawn`` and, beside them, ``limb`` in A poses.

    ``turns`` (A,) are its angles, ``lengths`` (A,) what is added to the logarithm of its length factor; numbers that
    the plan does not have are left out. The other parts are drawn once. ``x`` is left as it was.
    """
    height, width = eyes.alpha.shape[2], eyes.alpha.shape[3]
    desk = desk_of(plan.shape.size, height, width)
    cover, rows = np.zeros((height, width)), row_ends(height, width)
    turn, length = plan.where[limb, TURN], plan.where[limb, LENGTH]
    out = np.zeros((frames.size, turns.size))
    for b in range(frames.size):
        old_turn, old_length = read(x[b], turn), read(x[b], length)
        for eye in range(2):
            place_parts(plan, x[b], desk.centre, desk.axes, desk.size)
            before = 0.5 * eyes.blank[frames[b]]
            before += draw(plan, drawn, eyes, frames[b], eye, desk, cover, rows, True)
            for a in range(turns.size):
                if turn >= 0:
                    x[b, turn] = turns[a]
                if length >= 0:
                    x[b, length] = old_length + lengths[a]
                place_parts(plan, x[b], desk.centre, desk.axes, desk.size)
                out[b, a] += before + draw(plan, 1 << limb, eyes, frames[b], eye, desk, cover, rows, False)
            if turn >= 0:
                x[b, turn] = old_turn
            if length >= 0:
                x[b, length] = old_length
            clear(cover, rows)
    return out


@compiled
def linearised(
    plan: Plan,
    drawn: int,
    eyes: Eyes,
    frames: NDArray[np.int64],
    x: NDArray[np.float64],
    free: NDArray[np.int64],
    steps: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Cost (B,), half its gradient (B, n) and its Gauss-Newton matrix (B, n, n) for the n numbers ``free`` of x.

    ``x`` (B, m) is left as it was; ``steps`` (n,) are the steps of the forward differences.
    """
    height, width = eyes.alpha.shape[2], eyes.alpha.shape[3]
    n = free.size
    high, room = (height, _ROOM) if n > 0 else (0, 0)  # what only derivatives need
    desk = desk_of(plan.shape.size, height, width)
    here, there = np.zeros((height, width)), np.zeros((high, width))
    rows, others = row_ends(height, width), row_ends(high, width)
    slot = np.full((high, width), -1, np.int64)
    slopes, rests = np.empty((room, n)), np.empty(room)
    spots = np.empty((room, 2), np.int64)
    cost, gradient, matrix = np.empty(frames.size), np.zeros((frames.size, n)), np.zeros((frames.size, n, n))
    for b in range(frames.size):
        cost[b] = eyes.blank[frames[b]]
        for eye in range(2):
            used = 0
            place_parts(plan, x[b], desk.centre, desk.axes, desk.size)
            cost[b] += draw(plan, drawn, eyes, frames[b], eye, desk, here, rows, True)
            for j in range(n):
                kept = x[b, free[j]]
                x[b, free[j]] = kept + steps[j]
                place_parts(plan, x[b], desk.centre, desk.axes, desk.size)
                x[b, free[j]] = kept
                draw(plan, drawn, eyes, frames[b], eye, desk, there, others, True)
                for v in range(height):
                    for u in range(min(rows[2, v], others[2, v]), max(rows[3, v], others[3, v]) + 1):
                        gap = there[v, u] - here[v, u]
                        if abs(gap) > 1e-9 and eyes.alpha[frames[b], eye, v, u] >= 0.0:
                            p = slot[v, u]
                            if p < 0 and used < _ROOM:
                                p = used
                                used += 1
                                slot[v, u] = p
                                spots[p, 0], spots[p, 1] = v, u
                                slopes[p] = 0.0
                                rests[p] = here[v, u] - eyes.alpha[frames[b], eye, v, u]
                            if p >= 0:
                                slopes[p, j] = gap / steps[j]
                clear(there, others)
            clear(here, rows)
            for p in range(used):
                slot[spots[p, 0], spots[p, 1]] = -1
                for i in range(n):
                    s = slopes[p, i]
                    if s != 0.0:
                        gradient[b, i] += s * rests[p]
                        for j in range(i + 1):
                            matrix[b, i, j] += s * slopes[p, j]
        for i in range(n):
            for j in range(i):
                matrix[b, j, i] = matrix[b, i, j]
    return cost, gradient, matrix
