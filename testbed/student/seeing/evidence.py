"""How well a body explains what was seen: shares, needed parts and the evidence for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.motion import TeacherMotion
from testbed.student.parameters import EmbodiedParameters
from testbed.student.seeing._bundle import linearised
from testbed.student.seeing.alternatives import Alternative
from testbed.student.seeing.articulated import describe
from testbed.student.seeing.bundling import Fit, score, steps_of
from testbed.student.seeing.fitting import Film, prior_of

STRANGER = "stranger"
"""Stands for all bodies that nobody thought of."""


@dataclass(frozen=True)
class Explanation:
    """One body as an explanation of what was seen.

    Attributes:
        name: Short name of the body.
        words: How it differs from the own body, as half a sentence about "it".
        own: Whether it is the own body.
        parents: (k) the part that each part hangs on, -1 for the root.
        explained: Share of the squared darkness that it accounts for, at most 1.
        residual: Sum of squared residuals over key frames and eyes, pixels.
        log_likelihood: Logarithm of the evidence (Laplace): fit at the stated noise, less what its free numbers cost.
        free: How many numbers were fitted.
        motion: How its parts move, at the key frames (the own body: at all frames).
        needed: (k) by which share of the darkness the residual grows when a part is left out.
        idle: Parts that are not needed: a limb that hides behind others explains nothing of its own.
    """

    name: str
    words: str
    own: bool
    parents: tuple[int, ...]
    explained: float
    residual: float
    log_likelihood: float
    free: int
    motion: TeacherMotion
    needed: Vector
    idle: tuple[int, ...] = ()


def explanation_of(option: Alternative, fit: Fit, film: Film, parameters: EmbodiedParameters) -> Explanation:
    """What a fitted body explains, at its key frames."""
    body = fit.body
    everything = body.everything
    x = fit.numbers()
    without = [score(body, film.eyes, fit.frames, x, everything & ~(1 << i)) for i in range(len(body.limbs))]
    blank = max(float(fit.blank.sum()), 1e-9)
    needed = np.array([(float(cost.sum()) - float(fit.cost.sum())) / blank for cost in without])
    return Explanation(
        name=option.name,
        words=option.words,
        own=option.kind == "own",
        parents=tuple(int(parent) for parent in body.plan.parent),
        explained=fit.explained,
        residual=float(fit.cost.sum()),
        log_likelihood=log_evidence(fit, film, parameters),
        free=fit.poses.size + fit.shared.size,
        motion=motion_of(fit, film),
        needed=needed,
        idle=tuple(int(i) for i in np.flatnonzero(needed < parameters.idle)),
    )


def stranger_to(own: Fit, told: Explanation, film: Film, parameters: EmbodiedParameters) -> Explanation:
    """What a body that is none of those considered would explain: as free as the own body, nearly right."""
    alpha = np.maximum(film.eyes.alpha[own.frames], 0).astype(np.float64)
    residual = parameters.stranger * float((alpha * (1 - alpha)).sum())
    gain = (told.residual - residual) / (2 * parameters.fitting.noise)
    return Explanation(
        name=STRANGER,
        words="it has a body that I cannot think of",
        own=False,
        parents=(),
        explained=1 - residual / max(float(own.blank.sum()), 1e-9),
        residual=residual,
        log_likelihood=told.log_likelihood + gain,
        free=told.free,
        motion=TeacherMotion(film.times[own.frames], np.zeros((len(own.frames), 0, 8))),
        needed=np.zeros(0),
    )


def log_evidence(fit: Fit, film: Film, parameters: EmbodiedParameters) -> float:
    """Laplace's approximation of the logarithm of the probability of the key frames under a body plan.

    Residuals are Gaussian with the stated variance; every number that was fitted costs the logarithm of how much
    narrower it became by looking.
    """
    body, fitting = fit.body, parameters.fitting
    noise = fitting.noise
    prior = prior_of(body, film, fitting)
    spread = {"along": parameters.place_range, "up": parameters.place_range}
    wide = np.array([spread.get(name, math.radians(parameters.joint_range_deg)) for name in body.names])
    wide[body.pose :] = np.where(
        prior.precision > 0, np.sqrt(noise / np.maximum(prior.precision, 1e-12)), wide[body.pose :]
    )
    steps = steps_of(body, film.depth, float(film.eyes.camera[0]))
    free = np.arange(len(body.names))
    _, _, matrix = linearised(body.plan, body.everything, film.eyes, fit.frames, fit.numbers(), free, steps)
    scaled = matrix / noise * wide[None, :, None] * wide[None, None, :]
    m = body.pose
    own = scaled[:, :m, :m] + np.eye(m)
    cross = scaled[:, :m, m:]
    common = scaled[:, m:, m:].sum(0) + np.eye(body.shared)
    common -= np.einsum("bpi,bpj->ij", cross, np.linalg.solve(own, cross))
    occam = 0.5 * float(np.linalg.slogdet(own)[1].sum() + np.linalg.slogdet(common)[1])
    off = float(prior.precision @ (fit.shared - prior.mean) ** 2)
    return -(float(fit.cost.sum()) + off) / (2 * noise) - occam


def motion_of(fit: Fit, film: Film, order: tuple[int, ...] | None = None) -> TeacherMotion:
    """How the parts of a fit move, in the plan's order or in ``order``; rolls unwrapped."""
    parts = describe(fit.body, fit.numbers())
    parts[:, :, 4] = np.unwrap(parts[:, :, 4], axis=0)
    return TeacherMotion(film.times[fit.frames], parts[:, list(order)] if order else parts)
