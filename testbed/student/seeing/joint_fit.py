"""Parts that move freely: what a candidate does, without a word on how its parts hang together.

An extension of Section 3.3.2. As there, a teacher model is as many objects as the student has parts. Other than
there, all looks are explained together: shapes are the student's own parts, their sizes and depth are shared by all
frames, and only places and rolls differ. Nothing ties the parts to one another in what is minimised; hinged bodies
serve only as first guesses. Which ends stay together is left to be found out afterwards.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbed.bodies.morphology import Part, Vector
from testbed.student.motion import TeacherMotion, Watched
from testbed.student.parameters import FittingParameters, JointFitParameters
from testbed.student.seeing.articulated import Body, Limb, describe, lay_out
from testbed.student.seeing.bundling import Fit, bundle, score
from testbed.student.seeing.fitting import Film, film_of, followed, prior_of, refined, rough_fit, start_of
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import CUBOID, OMEGA, SPHERE


@dataclass(frozen=True)
class JointFit:
    """Free parts in motion.

    Attributes:
        motion: Main body first, then limbs; own x axes point away from what a limb stays next to.
        explained: Share of the squared darkness that is accounted for, at most 1.
        residual: Sum of squared residuals over frames and eyes, pixels.
        needed: (k) by which share of the darkness the residual grows when a part is left out.
        scale: Size relative to the student's own parts.
        lengths: (k) length factors besides that.
        yaw: By which angle the plane of motion is turned away from the image plane, rad.
    """

    motion: TeacherMotion
    explained: float
    residual: float
    needed: Vector
    scale: float
    lengths: Vector
    yaw: float


def joint_fit(
    watched: Watched,
    rig: StereoRig,
    parts: tuple[Part, ...],
    parameters: JointFitParameters | None = None,
    progress: Callable[[float], None] | None = None,
) -> JointFit:
    """Lay free parts into what was watched.

    Args:
        watched: Stereo pairs of one candidate.
        rig: The eyes that saw them.
        parts: The student's own parts, main body first; sizes are open by a common factor, limbs in length too.
        parameters: See :class:`JointFitParameters`.
        progress: Called with the share that is done, 0 to 1.

    Returns:
        The parts in motion.
    """
    parameters = parameters or JointFitParameters()
    progress = progress or (lambda share: None)
    fitting = parameters.fitting
    film = film_of(watched, rig, fitting)
    first = _first_guess(parts, film, parameters)
    progress(0.5)
    hinged = followed(refined(first, film, fitting), film, fitting)
    progress(0.8)
    fit = _set_free(hinged, film, parameters)
    progress(0.95)
    body, x = fit.body, fit.numbers()
    described = pointed_away(describe(body, x))
    everything = body.everything
    blank = max(float(fit.blank.sum()), 1e-9)
    without = [score(body, film.eyes, fit.frames, x, everything & ~(1 << i)).sum() for i in range(len(parts))]
    columns = [body.find("length", i) for i in range(len(parts))]
    progress(1.0)
    return JointFit(
        motion=TeacherMotion(film.times, described),
        explained=fit.explained,
        residual=float(fit.cost.sum()),
        needed=np.array([(float(cost) - float(fit.cost.sum())) / blank for cost in without]),
        scale=math.exp(float(x[0, body.find("scale")])),
        lengths=np.array([math.exp(float(x[0, i])) if i >= 0 else 1.0 for i in columns]),
        yaw=float(x[0, body.find("yaw")]),
    )


def _first_guess(parts: tuple[Part, ...], film: Film, parameters: JointFitParameters) -> Fit:
    """The best of a few hinged bodies: limbs are hung one after the other wherever most is explained."""
    fitting = parameters.fitting
    start: tuple[Limb, ...] = (Limb(parts[0], None, long=False),)
    kept: list[tuple[Limb, ...]] = [start]
    fits: list[Fit] = []
    for part in parts[1:]:
        grown = [(*limbs, limb) for limbs in kept for limb in _hung(limbs, part)]
        if len(grown) == 1 and len(parts) > 2:  # the first limb: facing tells which end it hangs on
            kept = grown
            continue
        fits = [_either_way(limbs, film, fitting) for limbs in grown]
        fits.sort(key=lambda fit: float(fit.cost.sum()))
        kept = [fit.body.limbs for fit in fits[: parameters.trees]]
    return fits[0] if fits else _either_way(kept[0], film, fitting)


def _hung(limbs: tuple[Limb, ...], part: Part) -> list[Limb]:
    """Where a further limb may hang: both ends of the main body (one, while nothing else does), far ends of limbs."""
    half = _half_length(limbs[0].part)
    spots = [(0, half, 0.0)] + ([(0, -half, math.pi)] if len(limbs) > 1 else [])
    spots += [(i, _half_length(limb.part), 0.0) for i, limb in enumerate(limbs) if i > 0]
    return [Limb(part, parent, (x, 0.0, 0.0), mount) for parent, x, mount in spots]


def _half_length(part: Part) -> float:
    return part.length_along_x / 2


def _either_way(limbs: tuple[Limb, ...], film: Film, fitting: FittingParameters) -> Fit:
    plan = lay_out(limbs)
    shared = start_of(plan, film)
    both = [rough_fit(way, film, shared, fitting) for way in (plan, plan.facing_other_way())]
    return min(both, key=lambda fit: float(fit.cost.sum()))


def _set_free(hinged: Fit, film: Film, parameters: JointFitParameters) -> Fit:
    """The same parts without hinges, then improved together."""
    body = hinged.body
    free = lay_out(tuple(replace(limb, parent=None, place=(0.0, 0.0, 0.0), mount=0.0) for limb in body.limbs))
    described = describe(body, hinged.numbers())
    yaw = float(hinged.shared[body.find("yaw") - body.pose])
    x = np.zeros((len(described), free.pose + free.shared))
    for i in range(len(body.limbs)):
        _put(free, x, i, described[:, i], yaw)
    for j, (name, owner) in enumerate(zip(free.names, free.owners, strict=True)):
        if j >= free.pose:
            x[:, j] = hinged.shared[body.find(name, owner) - body.pose]
    shared = x[0, free.pose :].copy()
    cost = score(free, film.eyes, hinged.frames, x)
    fit = Fit(free, hinged.frames, x[:, : free.pose], shared, cost, hinged.blank)
    prior = prior_of(free, film, parameters.fitting)
    return bundle(fit, film.eyes, prior, iterations=parameters.iterations)


def _put(free: Body, x: Vector, i: int, row: Vector, yaw: float) -> None:
    """Place part i as the objects ``row`` (F, 8) of Eq. 2 describe it, in a plane turned by ``yaw``."""
    x[:, free.find("along", i)] = row[:, 1] / math.cos(yaw)
    x[:, free.find("up", i)] = row[:, 2]
    # In the image a roll looks steeper than it is in a plane that is turned away.
    x[:, free.find("turn", i)] = np.arctan2(np.sin(row[:, OMEGA]) * math.cos(yaw), np.cos(row[:, OMEGA]))


def ends_of(parts: Vector) -> Vector:
    """(F, k, 2, 3) the near and far end of each part on its own x axis, where hinges sit; parts (F, k, 8).

    Depth is that of the centre: pitch and yaw are zero in Eq. 2.
    """
    half = 0.5 * np.where(parts[..., 0] == CUBOID, parts[..., 5], parts[..., 6])
    half = np.where(parts[..., 0] == SPHERE, parts[..., 5], half)
    axis = np.stack(
        [np.cos(parts[..., OMEGA]), np.sin(parts[..., OMEGA]), np.zeros(parts.shape[:-1])], axis=-1
    )
    reach = half[..., None] * axis
    return np.stack([parts[..., 1:4] - reach, parts[..., 1:4] + reach], axis=-2)


def pointed_away(parts: Vector) -> Vector:
    """The same objects (F, k, 8), limbs turned so that their near end is the one that stays next to another part.

    A limb's end belongs to where its distance to an end of a part that is already placed is smallest on the whole
    (root mean square over frames); limbs are placed in the order of that. Rolls never jump by a turn.
    """
    parts = parts.copy()
    placed = [0]
    rest = list(range(1, parts.shape[1]))
    ends = ends_of(parts)
    while rest:
        best = min(
            itertools.product(rest, (0, 1), placed, (0, 1)),
            key=lambda tie: float(
                np.mean(np.sum((ends[:, tie[0], tie[1], :2] - ends[:, tie[2], tie[3], :2]) ** 2, axis=-1))
            ),
        )
        limb, end = best[0], best[1]
        if end == 1:
            parts[:, limb, OMEGA] += math.pi
        placed.append(limb)
        rest.remove(limb)
    parts[:, :, OMEGA] = np.unwrap(parts[:, :, OMEGA], axis=0)
    first = parts[:1, :, OMEGA]
    parts[:, :, OMEGA] -= 2 * math.pi * np.round(first / (2 * math.pi))
    return parts
