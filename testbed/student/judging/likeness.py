"""Phase four of ``like_me``, the verdict with a probability and a reason (extensions of Section 3.4).

Whatever a rule measures becomes evidence, a number for or against, and the evidence a probability by a logistic curve
that was set by development teachers. At a probability of one half the answer changes.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
from scipy.special import expit

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.self_model import true_tree
from testbed.student.judging.verdict import Verdict
from testbed.student.motion import TeacherMotion
from testbed.student.moving.rehearsal import RehearsalRecord
from testbed.student.parameters import Calibration, LikenessParameters
from testbed.student.seeing.embodied import Embodiment
from testbed.student.seeing.evidence import STRANGER
from testbed.student.seeing.left_over import LeftOverParameters
from testbed.vision.primitives import CUBOID, D1, D2, OMEGA, SHAPE, SPHERE, X, Y

_MOST_ORDERED = 5  # of more parts than this the modeller's own order counts: 8 limbs have 40 320
_LEAST = 1e-3  # what is left unexplained, or apart, cannot be told from less


def by_fit(record: RehearsalRecord, parameters: LikenessParameters) -> Verdict:
    """The paper's rule with a rehearsed controller: how much of the motion is the student's own?"""
    share = max(0.0, record.r2)
    least = int(np.argmin(record.joint_r2))
    reason = f"I can reproduce {share:.0%} of its motion, and {max(0.0, record.joint_r2[least]):.0%} of what"
    reason += f" my joint {least + 1} would have done"
    return decided(np.array([record.score]), parameters.controller, reason)


def by_likelihood(seen: Embodiment, parameters: LikenessParameters) -> Verdict:
    """Does the own body explain what was seen better than the bodies that it could have had?"""
    evidence = np.array([math.asinh(seen.log_ratio / 10)])
    shares = (
        f"my own body explains {seen.own.explained:.1%} of what I saw, the best other body "
        f"{seen.best_other.explained:.1%}"
    )
    verdict = decided(evidence, parameters.likelihood, shares)
    reason = shares
    if verdict.answer == "inappropriate" and seen.best_other.name == STRANGER:
        reason = (
            f"{seen.best_other.words}, or is more than one: none that I can think of explains more than "
            f"{1 - seen.unexplained:.1%} of what I saw, my own {seen.own.explained:.1%}"
        )
        if seen.left_over >= LeftOverParameters().telling:
            reason += ", and what is left over is as thick as another main body"
    elif verdict.answer == "inappropriate":
        reason = f"{seen.best_other.words}: {shares}"
    elif seen.log_ratio < 0:
        reason = f"{shares}, too little more to speak against me"
    return replace(verdict, reason=reason)


def by_attachment(
    motion: TeacherMotion, explained: float, body: Morphology, parameters: LikenessParameters
) -> Verdict:
    """Do the parts that hang together in the own body stay together in the teacher's, and turn about there?

    ``explained`` is the share of what was seen that these parts account for: who has more parts shows more.
    """
    gaps, turns = hinges(motion, body)
    evidence = np.array(
        [
            -math.log(max(float(gaps.max()), _LEAST)),
            math.log(max(float(turns.min()), _LEAST)),
            -math.log(max(1 - explained, _LEAST)),
        ]
    )
    worst, stiffest = int(np.argmax(gaps)), int(np.argmin(turns))
    reason = (
        f"its part {worst + 2} stays within {gaps[worst]:.0%} of a limb's length of where my limb {worst + 1} "
        f"would hang, and its joint {stiffest + 1} turns by {math.degrees(turns[stiffest]):.0f} degrees"
    )
    return decided(evidence, parameters.attachment, reason)


def decided(evidence: Vector, calibration: Calibration, reason: str) -> Verdict:
    """A verdict from evidence (n,) by a calibrated logistic curve."""
    score = calibration.bias + float(np.dot(calibration.weights, evidence))
    probability = float(expit(score))
    return Verdict("appropriate" if score >= 0 else "inappropriate", score, probability, reason)


def hinges(motion: TeacherMotion, body: Morphology) -> tuple[Vector, Vector]:
    """How well a teacher's free parts hang together the way the own body's do.

    Of all assignments of objects to limbs, and of all directions in which the objects may point, the one with the
    smallest gaps counts; the first object is the main body.

    Args:
        motion: Free parts: nothing has tied them together.
        body: The student's self-model.

    Returns:
        gaps (joints,): root mean square distance in the image plane between a limb's near end and the place on its
        parent where it would hang, in mean limb lengths. turns (joints,): standard deviation of the angle there, rad.
    """
    parents, angles = true_tree(body)
    count = motion.parts.shape[1]
    ends = np.stack([_end(motion.parts, sign) for sign in (1.0, -1.0)])  # (2, F, k, 2)
    size = float(np.mean([_length(motion.parts[:, part]).mean() for part in range(1, count)]))
    best: tuple[float, Vector, tuple[int, ...]] | None = None
    orders = itertools.permutations(range(1, count)) if count <= _MOST_ORDERED else [tuple(range(1, count))]
    for limbs in orders:
        objects = (0, *limbs)
        for points in itertools.product((0, 1), repeat=count):
            apart = []
            for limb, (parent, angle) in enumerate(zip(parents, angles, strict=True)):
                near = ends[1 - points[limb + 1], :, objects[limb + 1]]
                far = ends[points[parent], :, objects[parent]]
                if parent == 0:  # a hinge on the main body sits somewhere between its middle and an end
                    middle = motion.parts[:, 0, [X, Y]]
                    far = middle + (far - middle) * math.cos(angle)
                apart.append(float(np.sqrt(np.mean(np.sum((near - far) ** 2, axis=1)))) / size)
            if best is None or max(apart) < best[0]:
                best = max(apart), np.array(apart), objects
    assert best is not None
    _, gaps, objects = best
    rolls = motion.parts[:, list(objects), OMEGA]
    turns = np.array([np.std(rolls[:, limb + 1] - rolls[:, parent]) for limb, parent in enumerate(parents)])
    return gaps, turns


def _end(parts: Vector, sign: float) -> Vector:
    """One end (F, k, 2) of every object in the image plane, m: where a hinge could be."""
    half = _length(parts)[..., None] / 2
    ahead = np.stack([np.cos(parts[..., OMEGA]), np.sin(parts[..., OMEGA])], axis=-1)
    return np.asarray(parts[..., [X, Y]] + sign * half * ahead)


def _length(parts: Vector) -> Vector:
    """Length (...) along an object's own x between the places where hinges sit, m."""
    return np.select(
        [parts[..., SHAPE] == CUBOID, parts[..., SHAPE] == SPHERE],
        [parts[..., D1], 2 * parts[..., D1]],
        parts[..., D2],
    )
