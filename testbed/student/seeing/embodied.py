"""Seeing others as what one's own body could be (an extension of Section 3.3.2).

The student lays its own self-model into the film of a candidate, only size and lengths of limbs left open, and does
the same with bodies that are one edit away. What explains the film best, and by how much, is evidence about whether
the candidate is like itself; the poses of its own body are how the candidate moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.motion import TeacherMotion, Watched
from testbed.student.parameters import EmbodiedParameters, FittingParameters
from testbed.student.seeing.alternatives import Alternative, alternatives, own_limbs, thinned
from testbed.student.seeing.articulated import Body, lay_out
from testbed.student.seeing.bundling import Fit, bundle, score, settle_poses
from testbed.student.seeing.evidence import STRANGER, Explanation, explanation_of, motion_of, stranger_to
from testbed.student.seeing.fitting import (
    Film,
    film_of,
    fit_body,
    followed,
    prior_of,
    refined,
    rough_fit,
    start_of,
)
from testbed.student.seeing.left_over import LeftOverParameters, left_over
from testbed.student.seeing.posing import best_few, grow
from testbed.vision.camera import StereoRig

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Embodiment:
    """What came of laying the own body and others into a film.

    Attributes:
        explanations: The own body first, then the others from the best to the worst; those with a limb more that is
            not needed come last, since they say nothing else than the own body does. One of them, ``stranger``,
            stands for bodies that nobody thought of: no parts, and the evidence that any right body would have.
        motion: How the candidate moves if it has the own body: parts in the order of the own body's parts.
        explained: Share of the squared darkness that the own body accounts for over all frames.
        scale: Size of the candidate relative to the own body.
        lengths: (k) length factors of the own body's parts besides that.
        yaw: By which angle the plane of motion is turned away from the image plane, rad.
        swings: (k) range that each joint moves through, rad; the root's is of its roll.
        unexplained: Share of the squared darkness that none of these bodies accounts for; a stranger is none.
        left_over: Of a stranger, the share of the darkness that is left over and as thick as a main body; else 0.
    """

    explanations: tuple[Explanation, ...]
    motion: TeacherMotion
    explained: float
    scale: float
    lengths: Vector
    yaw: float
    swings: Vector
    unexplained: float = 0.0
    left_over: float = 0.0

    @property
    def own(self) -> Explanation:
        """The own body as an explanation."""
        return self.explanations[0]

    @property
    def best_other(self) -> Explanation:
        """The best of the other bodies."""
        return self.explanations[1]

    @property
    def log_ratio(self) -> float:
        """How much more probable the film is under the own body than under the best other, as a logarithm."""
        return self.own.log_likelihood - self.best_other.log_likelihood


def embodied(
    watched: Watched,
    rig: StereoRig,
    body: Morphology,
    parameters: EmbodiedParameters | None = None,
    progress: Progress | None = None,
) -> Embodiment:
    """Lay the own body and bodies one edit away into what was watched.

    Args:
        watched: Stereo pairs of one candidate.
        rig: The eyes that saw them.
        body: The own body, as the student believes it to be.
        parameters: See :class:`EmbodiedParameters`.
        progress: Called with the share that is done, 0 to 1.

    Returns:
        The explanations and the motion.
    """
    parameters = parameters or EmbodiedParameters()
    progress = progress or _silent
    fitting = parameters.fitting
    film = film_of(watched, rig, fitting)
    limbs, order = own_limbs(body)
    options = alternatives(limbs)
    own = fit_body(lay_out(limbs), film, fitting)
    progress(0.25)
    whole = followed(own, film, fitting)
    progress(0.4)
    own = _better(own, whole, film, fitting)
    others = _others(options[1:], own, film, parameters)
    progress(0.95)
    places = np.argsort(order)
    motion = motion_of(whole, film, tuple(int(i) for i in places))
    told = [explanation_of(options[0], own, film, parameters)]
    told[0] = replace(told[0], motion=motion)
    rest = [explanation_of(option, fit, film, parameters) for option, fit in others]
    rest.append(stranger_to(own, told[0], film, parameters))
    more = len(limbs)
    rest.sort(key=lambda other: (bool(other.idle) and len(other.parents) > more, -other.log_likelihood))
    known = max((each for each in (*told, *rest) if each.name != STRANGER), key=lambda each: each.explained)
    strange = rest[0].name == STRANGER and rest[0].log_likelihood > told[0].log_likelihood
    progress(1.0)
    common = whole.body.plan.common - whole.body.pose
    return Embodiment(
        explanations=(told[0], *rest),
        motion=motion,
        explained=whole.explained,
        scale=math.exp(float(whole.shared[common[0]])),
        lengths=_lengths(whole)[places],
        yaw=float(whole.shared[common[2]]),
        swings=_swings(whole)[places],
        unexplained=1 - known.explained,
        left_over=left_over(film, rig, known, told[0], LeftOverParameters()) if strange else 0.0,
    )


def _silent(share: float) -> None:
    """No progress is shown."""


def _better(own: Fit, whole: Fit, film: Film, parameters: FittingParameters) -> Fit:
    """The key frames' fit begun anew from that of all frames, if that is better."""
    at = np.searchsorted(whole.frames, own.frames)
    start = Fit(own.body, own.frames, whole.poses[at], whole.shared, whole.cost[at], own.blank)
    again = bundle(start, film.eyes, prior_of(own.body, film, parameters), iterations=parameters.iterations)
    return again if again.cost.sum() < own.cost.sum() else own


def _others(
    options: tuple[Alternative, ...], own: Fit, film: Film, parameters: EmbodiedParameters
) -> list[tuple[Alternative, Fit]]:
    """Fits of the other bodies."""
    fitting = parameters.fitting
    fits: list[tuple[Alternative, Fit]] = []
    cold: list[tuple[Alternative, Fit]] = []
    for option in options:
        warm = own.explained >= parameters.good and option.kind in ("moved", "added", "thin")
        if option.kind == "frozen" or warm:
            fits.append((option, _warm(option, own, film, fitting)))
        else:
            cold.append((option, _cold(option, own, film, fitting)))
    cold.sort(key=lambda pair: float(pair[1].cost.sum()))
    moved = next((option for option, _ in cold if option.kind == "moved"), None)
    flat = thinned(moved) if moved else None
    if flat is not None:
        cold.append((flat, _cold(flat, own, film, fitting)))
        cold.sort(key=lambda pair: float(pair[1].cost.sum()))
    for rank, (option, fit) in enumerate(cold):
        done = refined(fit, film, fitting) if rank < parameters.finalists or option.kind == "single" else fit
        fits.append((option, done))
    return fits


def _cold(option: Alternative, own: Fit, film: Film, fitting: FittingParameters) -> Fit:
    """A rough fit of an alternative from nothing; a further limb may also join the own body where that lies."""
    plan = lay_out(option.limbs)
    shared = start_of(plan, film)
    ways = (plan, plan.facing_other_way()) if option.kind != "single" else (plan,)
    rough = [rough_fit(way, film, shared, fitting) for way in ways]
    if option.kind == "added":
        rough.append(_warm(option, own, film, fitting))
    return min(rough, key=lambda fit: float(fit.cost.sum()))


def _warm(option: Alternative, own: Fit, film: Film, fitting: FittingParameters) -> Fit:
    """An alternative from the own body's numbers: what is the same is taken over, new limbs are sought."""
    plan = lay_out(option.limbs, own.body.facing)
    numbers = own.numbers()
    x = np.zeros((len(numbers), plan.pose + plan.shared))
    drawn = 0
    for part, before in enumerate(option.kept):
        moved = before is None or (before > 0 and _hinge(option, part) != _own_hinge(own.body, before))
        if not moved:
            drawn |= 1 << part
        for i, (name, owner) in enumerate(zip(plan.names, plan.owners, strict=True)):
            if owner == part and before is not None:
                old = own.body.find(name, before)
                if old >= 0:
                    x[:, i] = numbers[:, old]
                if old >= 0 and i >= plan.pose > 0:
                    x[:, i] = np.median(numbers[:, old])
    for name in ("scale", "depth", "yaw"):
        x[:, plan.find(name)] = numbers[:, own.body.find(name)]
    which = own.frames
    cost = score(plan, film.eyes, which, x)
    if drawn != plan.everything:
        which, x, cost = grow(plan, film.eyes, which, x, drawn, film.pixel, fitting.posing, fitting.lengths)
        few = best_few(which, cost, 1)
        x = x[few]
    shared = np.median(x[:, plan.pose :], axis=0)
    x[:, plan.pose :] = shared
    x, cost = settle_poses(plan, film.eyes, own.frames, x, iterations=5)
    fit = Fit(plan, own.frames, x[:, : plan.pose], shared, cost, own.blank)
    return bundle(fit, film.eyes, prior_of(plan, film, fitting), iterations=fitting.iterations)


def _hinge(option: Alternative, part: int) -> tuple[object, float]:
    limb = option.limbs[part]
    parent = None if limb.parent is None else option.kept[limb.parent]
    return parent, round(math.cos(limb.mount), 3)


def _own_hinge(body: Body, part: int) -> tuple[object, float]:
    limb = body.limbs[part]
    return limb.parent, round(math.cos(limb.mount), 3)


def _lengths(fit: Fit) -> Vector:
    columns = [fit.body.find("length", i) - fit.body.pose for i in range(len(fit.body.limbs))]
    return np.array([math.exp(float(fit.shared[i])) if i >= 0 else 1.0 for i in columns])


def _swings(fit: Fit) -> Vector:
    columns = [fit.body.find("turn", i) for i in range(len(fit.body.limbs))]
    return np.array([float(np.ptp(fit.poses[:, i])) if 0 <= i < fit.body.pose else 0.0 for i in columns])
