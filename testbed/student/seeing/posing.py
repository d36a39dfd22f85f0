"""First guesses for a body in silhouettes: how far away, how large, and in which pose in each frame.

Poses are built from the root outwards: places and rolls of the root that explain most darkness, then for each limb a
fan of angles, the best few kept and improved after every limb. Many hypotheses of many frames go through the
compiled renderer together.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.student.parameters import PosingParameters
from testbed.student.seeing._bundle import fan_costs
from testbed.student.seeing._plan import Eyes
from testbed.student.seeing.articulated import Body, Indices
from testbed.student.seeing.bundling import score, settle_poses
from testbed.vision.camera import StereoRig


def depth_of(alpha: NDArray[np.float32], rig: StereoRig) -> float:
    """Depth (m) of what is seen, from the shift that lays the left silhouettes over the right: median over frames.

    ``alpha`` (F, 2, height, width). Without a baseline, or if nothing is seen, one metre.
    """
    found = []
    for left, right in alpha:
        rows = np.flatnonzero(left.any(1) | right.any(1))
        if not rows.size or not left.any() or not right.any():
            continue
        a, b = left[rows[0] : rows[-1] + 1], right[rows[0] : rows[-1] + 1]
        spectrum = np.fft.rfft(a, 256, axis=1) * np.conj(np.fft.rfft(b, 256, axis=1))
        match = np.fft.irfft(spectrum.sum(0), 256)[: rig.width]
        best = int(match.argmax())
        if 0 < best < rig.width - 1:
            before, here, after = match[best - 1 : best + 2]
            found.append(best + 0.5 * (before - after) / min(before - 2 * here + after, -1e-9))
    if not found or rig.baseline == 0:
        return 1.0
    return rig.focal * rig.baseline / max(float(np.median(found)), 0.5)


def dark_places(image: NDArray[np.float32], radius: float, count: int) -> Vector:
    """(n, 2) columns and rows of up to ``count`` places with most darkness within ``radius``, all in pixels."""
    blurred = cv2.GaussianBlur(image, (0, 0), max(radius, 0.5)).astype(np.float64)
    spots = []
    for _ in range(count):
        v, u = np.unravel_index(int(blurred.argmax()), blurred.shape)
        if blurred[v, u] <= 0.05:
            break
        spots.append((u + 0.5, v + 0.5))
        r = max(radius, 1.0)
        top, left = max(0, int(v - r)), max(0, int(u - r))
        blurred[top : int(v + r) + 1, left : int(u + r) + 1] = 0.0
    return np.array(spots).reshape(-1, 2)


def best_few(frames: Indices, cost: Vector, keep: int, keys: Vector | None = None) -> Indices:
    """Which hypotheses to keep: the ``keep`` cheapest of each frame, of those with equal ``keys`` only the cheapest."""
    order = np.lexsort((cost, frames))
    if keys is not None:
        tagged = np.column_stack([frames, keys])[order]
        _, first = np.unique(tagged, axis=0, return_index=True)
        order = order[np.sort(first)]
    sorted_frames = frames[order]
    starts = np.flatnonzero(np.r_[True, sorted_frames[1:] != sorted_frames[:-1]])
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    return order[rank < keep]


def _keys(body: Body, x: Vector, drawn: int, pixel: float) -> Vector:
    """Poses rounded to two pixels and ten degrees: what is equal here is one hypothesis."""
    width = {"along": 2 * pixel, "up": 2 * pixel, "turn": math.radians(10)}
    columns = [i for i in range(body.pose) if (drawn >> body.owners[i]) & 1]
    return np.stack([np.rint(x[:, i] / width[body.names[i]]) for i in columns], axis=1)


def first_roots(
    body: Body, eyes: Eyes, frames: Indices, shared: Vector, parameters: PosingParameters
) -> tuple[Indices, Vector]:
    """Hypotheses (B,), (B, m + q) with the root placed in each frame."""
    depth = float(shared[body.plan.common[1] - body.pose])
    scale = math.exp(float(shared[body.plan.common[0] - body.pose]))
    pixel = depth / float(eyes.camera[0])
    thin = min(value for value in body.plan.size[0] if value > 0) * scale / pixel
    rolls = (np.arange(parameters.rolls) / parameters.rolls - 0.5) * math.pi
    if body.plan.shape[0] == 1:
        rolls = np.zeros(1)
    which, rows = [], []
    for frame in frames:
        spots = dark_places(np.maximum(eyes.alpha[frame, 0], 0), thin / 2, parameters.places)
        if not len(spots):
            spots = eyes.camera[None, 1:]
        along = (spots[:, 0] - eyes.camera[1]) * pixel + eyes.places[0]
        up = (spots[:, 1] - eyes.camera[2]) * pixel
        x = np.zeros((len(spots) * len(rolls), body.pose + body.shared))
        x[:, body.pose :] = shared
        x[:, body.plan.where[0, 0]] = np.repeat(along, len(rolls))
        x[:, body.plan.where[0, 1]] = np.repeat(up, len(rolls))
        if body.plan.where[0, 2] < body.pose:
            x[:, body.plan.where[0, 2]] = np.tile(rolls, len(spots))
        rows.append(x)
        which.append(np.full(len(x), frame))
    return np.concatenate(which), np.concatenate(rows)


def pose_from_nothing(
    body: Body,
    eyes: Eyes,
    frames: Indices,
    shared: Vector,
    parameters: PosingParameters,
    lengths: tuple[float, ...] = (1.0,),
    *,
    overturned: bool = False,
) -> tuple[Indices, Vector, Vector]:
    """The best few poses of each frame without knowing any: frames (B,), numbers (B, m + q), cost (B,).

    Hinges that are frozen keep the angle that ``shared`` (q,) gives them. Every limb is tried with the factors
    ``lengths``; with ``overturned`` the root may also lie on its back.
    """
    which, x = first_roots(body, eyes, frames, shared, parameters)
    cost = score(body, eyes, which, x, 1)
    pixel = float(shared[body.plan.common[1] - body.pose]) / float(eyes.camera[0])
    few = best_few(which, cost, parameters.kept)
    which, x = which[few], x[few]
    turn = int(body.plan.where[0, 2])
    if overturned and turn < body.pose:
        which, x = np.tile(which, 2), np.tile(x, (2, 1))
        x[len(x) // 2 :, turn] += math.pi
    return grow(body, eyes, which, x, 1, pixel, parameters, lengths)


def grow(
    body: Body,
    eyes: Eyes,
    which: Indices,
    x: Vector,
    drawn: int,
    pixel: float,
    parameters: PosingParameters,
    lengths: tuple[float, ...] = (1.0,),
) -> tuple[Indices, Vector, Vector]:
    """Add the limbs that are not in ``drawn`` to the hypotheses, one after the other."""
    x, cost = settle_poses(body, eyes, which, x, drawn=drawn, iterations=parameters.steps)
    travel = math.radians(parameters.travel_deg)
    fan = np.linspace(-travel, travel, parameters.angles)
    for limb in range(len(body.limbs)):
        if (drawn >> limb) & 1:
            continue
        turn, stretch = int(body.plan.where[limb, 2]), int(body.plan.where[limb, 3])
        moving = fan if turn < body.pose else x[:1, turn]
        factors = np.log(lengths) if stretch >= 0 else np.zeros(1)
        turns, longer = np.repeat(moving, len(factors)), np.tile(factors, len(moving))
        cost = fan_costs(body.plan, drawn, limb, eyes, which, np.ascontiguousarray(x), turns, longer)
        drawn |= 1 << limb
        few = best_few(np.repeat(which, len(turns)), cost.ravel(), parameters.kept)
        which, x = which[few // len(turns)], x[few // len(turns)]
        x[:, turn] = turns[few % len(turns)]
        if stretch >= 0:
            x[:, stretch] += longer[few % len(turns)]
        x, cost = settle_poses(body, eyes, which, x, drawn=drawn, iterations=parameters.steps)
        few = best_few(which, cost, parameters.kept, _keys(body, x, drawn, pixel))
        which, x, cost = which[few], x[few], cost[few]
    return which, x, cost
