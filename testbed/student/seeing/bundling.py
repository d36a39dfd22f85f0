"""Better poses and sizes by small steps: Levenberg-Marquardt on silhouettes (an extension of Section 3.3.2).

Every frame has a pose of its own; sizes, depth and the plane of motion are shared. The system of all frames is solved
by a Schur complement, as in bundle adjustment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.seeing._bundle import costs, linearised
from testbed.student.seeing._plan import DEPTH, Eyes
from testbed.student.seeing.articulated import Body, Indices


@dataclass(frozen=True)
class Fit:
    """Poses and shared numbers of a body in some frames.

    Attributes:
        body: The plan.
        frames: (B,) which frames.
        poses: (B, m).
        shared: (q,).
        cost: (B,) sum of squared residuals of each frame.
        blank: (B,) what explaining nothing costs.
    """

    body: Body
    frames: Indices
    poses: Vector
    shared: Vector
    cost: Vector
    blank: Vector

    @property
    def explained(self) -> float:
        """Share of the (squared) darkness that is accounted for, at most 1."""
        return float(1 - self.cost.sum() / max(self.blank.sum(), 1e-9))

    def numbers(self) -> Vector:
        """(B, m + q) all numbers of each frame."""
        return np.hstack([self.poses, np.broadcast_to(self.shared, (len(self.poses), len(self.shared)))])


@dataclass(frozen=True)
class Prior:
    """What is expected of the shared numbers of a body, each (q,).

    Attributes:
        mean: Expected values.
        precision: Cost of a squared deviation; infinity keeps a number where it is.
        low: Least values.
        high: Greatest values.
    """

    mean: Vector
    precision: Vector
    low: Vector
    high: Vector

    def held(self, body: Body, *names: str) -> Prior:
        """The same with some numbers kept where they are."""
        kept = [name in names for name in body.names[body.pose :]]
        return replace(self, precision=np.where(kept, np.inf, self.precision))


def steps_of(body: Body, depth: float, focal: float) -> Vector:
    """Steps of the finite differences: about a tenth of a pixel at the end of a limb."""
    pixel = depth / focal
    size = {
        "along": 0.15 * pixel,
        "up": 0.15 * pixel,
        "turn": 0.02,
        "scale": 0.01,
        "depth": 0.01 * depth,
        "yaw": 0.03,
        "length": 0.02,
        "thickness": 0.05,
    }
    return np.array([size[name] for name in body.names])


def score(body: Body, eyes: Eyes, frames: Indices, x: Vector, drawn: int | None = None) -> Vector:
    """(B,) cost of the numbers x (B, m + q) in the frames (B,)."""
    drawn = body.everything if drawn is None else drawn
    return costs(body.plan, drawn, eyes, frames, np.ascontiguousarray(x))


def settle_poses(
    body: Body,
    eyes: Eyes,
    frames: Indices,
    x: Vector,
    *,
    drawn: int | None = None,
    iterations: int = 4,
    damping: float = 0.02,
    loose: Mapping[str, float] | None = None,
) -> tuple[Vector, Vector]:
    """Improve the poses of many hypotheses at once (Levenberg-Marquardt).

    Args:
        body: The plan.
        eyes: What was seen.
        frames: (B,) the frame of each hypothesis.
        x: (B, m + q) start.
        drawn: Bit set of parts that are there; numbers of others are not touched.
        iterations: Steps at most.
        damping: Of the first step.
        loose: Names of shared numbers that each hypothesis may change for itself, with the cost of a squared
            deviation from the start; all others are kept.

    Returns:
        Better x (B, m + q) and cost (B,), without that of deviations.
    """
    drawn = body.everything if drawn is None else drawn
    loose = loose or {}
    x = np.array(x, float)
    free = np.array(
        [
            i
            for i, (name, owner) in enumerate(zip(body.names, body.owners, strict=True))
            if (i < body.pose or name in loose) and (owner < 0 or (drawn >> owner) & 1)
        ],
        np.int64,
    )
    precision = np.array([loose[body.names[i]] if i >= body.pose else 0.0 for i in free])
    start = x[:, free].copy()
    steps = steps_of(body, float(x[0, body.plan.common[DEPTH]]), float(eyes.camera[0]))
    widest = _widest(body, steps)[free]
    damp = np.full(len(x), damping)
    cost = np.full(len(x), np.inf)
    todo, diagonal = np.arange(len(x)), np.arange(len(free))
    for _ in range(iterations):
        if not todo.size:
            break
        now, gradient, matrix = linearised(body.plan, drawn, eyes, frames[todo], x[todo], free, steps[free])
        off = x[np.ix_(todo, free)] - start[todo]
        now = now + off**2 @ precision
        gradient += precision * off
        matrix[:, diagonal, diagonal] += precision
        cost[todo] = now
        step = _solve(matrix, gradient, damp[todo], steps[free])
        step = np.clip(step, -widest, widest)
        trial = x[todo]
        trial[:, free] += step
        after = costs(body.plan, drawn, eyes, frames[todo], trial)
        after += (trial[:, free] - start[todo]) ** 2 @ precision
        better = after < now
        x[todo[better]] = trial[better]
        cost[todo[better]] = after[better]
        damp[todo] *= np.where(better, 0.3, 8.0)
        todo = todo[~(better & (now - after < 1e-3 * now)) & (damp[todo] < 1e4)]
    return x, cost - (x[:, free] - start) ** 2 @ precision


def _widest(body: Body, steps: Vector) -> Vector:
    """The greatest step of one iteration for each number: two pixels, 20 deg, a fifth."""
    size = {
        "along": 14,
        "up": 14,
        "turn": 17,
        "scale": 15,
        "depth": 10,
        "yaw": 4,
        "length": 8,
        "thickness": 5,
    }
    widest: Vector = steps * np.array([size[name] for name in body.names])
    return widest


def _solve(matrix: Vector, gradient: Vector, damp: Vector, steps: Vector) -> Vector:
    """(B, n) damped Gauss-Newton steps."""
    n = matrix.shape[1]
    diagonal = np.einsum("bii->bi", matrix)
    scale = diagonal * damp[:, None] + 1e-3 / steps**2 * 1e-2
    step: Vector = -np.linalg.solve(matrix + scale[:, :, None] * np.eye(n), gradient[:, :, None])[:, :, 0]
    return step


def bundle(
    fit: Fit,
    eyes: Eyes,
    prior: Prior,
    *,
    iterations: int = 12,
    damping: float = 0.01,
    tolerance: float = 2e-4,
) -> Fit:
    """Improve poses and shared numbers together: bundle adjustment by Levenberg-Marquardt with a Schur complement.

    Args:
        fit: Where to begin.
        eyes: What was seen.
        prior: What is expected of the shared numbers, and what is kept.
        iterations: Steps at most.
        damping: Of the first step.
        tolerance: It ends when a step gains less than this share of the cost.

    Returns:
        The better fit; its cost is without the prior's.
    """
    body, frames = fit.body, fit.frames
    m = body.pose
    held = ~np.isfinite(prior.precision)
    precision = np.where(held, 0.0, prior.precision)
    free_shared = np.flatnonzero(~held)
    free = np.concatenate([np.arange(m), m + free_shared])
    shared = np.where(held, fit.shared, np.clip(fit.shared, prior.low, prior.high))
    x = np.hstack([fit.poses, np.tile(shared, (len(fit.poses), 1))])
    steps = steps_of(body, float(x[0, body.plan.common[DEPTH]]), float(eyes.camera[0]))
    widest = _widest(body, steps)
    damp = damping

    def penalty(values: Vector) -> float:
        return float(precision @ (values - prior.mean) ** 2)

    cost = score(body, eyes, frames, x)
    for _ in range(iterations):
        _, gradient, matrix = linearised(body.plan, body.everything, eyes, frames, x, free, steps[free])
        before = float(cost.sum()) + penalty(shared)
        improved = False
        while damp < 1e4:
            pose_step, shared_step = _schur(
                matrix,
                gradient,
                m,
                damp,
                steps[free],
                (precision * (shared - prior.mean))[free_shared],
                precision[free_shared],
            )
            trial_shared = shared.copy()
            trial_shared[free_shared] += np.clip(
                shared_step, -widest[m:][free_shared], widest[m:][free_shared]
            )
            trial_shared = np.where(held, shared, np.clip(trial_shared, prior.low, prior.high))
            trial = np.hstack(
                [x[:, :m] + np.clip(pose_step, -widest[:m], widest[:m]), np.tile(trial_shared, (len(x), 1))]
            )
            after_cost = score(body, eyes, frames, trial)
            after = float(after_cost.sum()) + penalty(trial_shared)
            if after < before:
                improved = True
                x, shared, cost = trial, trial_shared, after_cost
                damp *= 0.3
                break
            damp *= 6.0
        if not improved or before - after < tolerance * before:
            break
    return Fit(body, frames, x[:, :m], shared, cost, eyes.blank[frames])


def _schur(
    matrix: Vector, gradient: Vector, m: int, damp: float, steps: Vector, pull: Vector, precision: Vector
) -> tuple[Vector, Vector]:
    """Steps of the poses (B, m) and of the shared numbers (q,)."""
    tiny = 1e-5 / steps**2
    pp = matrix[:, :m, :m].copy()
    diagonal = np.arange(m)
    pp[:, diagonal, diagonal] = pp[:, diagonal, diagonal] * (1 + damp) + tiny[:m]
    ps = matrix[:, :m, m:]
    ss = matrix[:, m:, m:].sum(0)
    gp, gs = gradient[:, :m], gradient[:, m:].sum(0) + pull
    inner = np.linalg.solve(pp, np.concatenate([ps, gp[:, :, None]], axis=2))
    w, v = inner[:, :, :-1], inner[:, :, -1]
    ss = ss + np.diag(np.diag(ss) * damp + tiny[m:] + precision)
    reduced = ss - np.einsum("bpi,bpj->ij", ps, w)
    shared = -np.linalg.solve(reduced, gs - np.einsum("bpi,bp->i", ps, v))
    return -v - w @ shared, shared
