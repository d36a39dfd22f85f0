"""How to read a teacher: from which side it is seen, and which of its objects is which of my parts (Section 3.4.2)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from testbed.bodies.morphology import CappedCylinder, Morphology, Vector
from testbed.student.motion import TeacherMotion
from testbed.student.moving.harmonics import Harmonics
from testbed.student.moving.imitation import normalised
from testbed.student.moving.rehearsal_search import joint_angles, root_roll
from testbed.student.moving.rolls import view_of
from testbed.vision.primitives import CUBOID, D1, D2, SHAPE, SPHERE, X, Y

_TURN = 2 * math.pi
_MOST_LIMBS = 4  # more than 4! = 24 correspondences are not tried one by one


@dataclass(frozen=True)
class Reading:
    """One way to read a teacher.

    Attributes:
        mirrored: Whether it is taken for one seen from its other side.
        order: (k,) the object that corresponds to each part of the student.
        rhythm: Its rolls at any time, the objects in the order in which they are fed to the network.
        body: The self-model that is compared with it, in its proportions if so wanted.
        misplaced: How far its parts are from where that body's would be, see :func:`misplacement`.
    """

    mirrored: bool
    order: NDArray[np.int64]
    rhythm: Harmonics
    body: Morphology
    misplaced: float


def readings(
    body: Morphology,
    motion: TeacherMotion,
    rhythm: Harmonics,
    poses: int,
    bounds: tuple[float, float],
    main_known: bool = True,
) -> list[Reading]:
    """Every plausible reading, the nearest first.

    A teacher seen from its other side is a mirror image: its rolls are pi minus those that the student would have.
    Positions cannot tell it from one that lies on its back and faces the other way; a main body that is upright
    can. Which object is which part is decided by positions.

    Args:
        body: The student's self-model.
        motion: What was seen.
        rhythm: Of the rolls seen.
        poses: At how many moments positions are compared.
        bounds: Between which factors the self-model's limbs take the teacher's proportions.
        main_known: Whether the first object is known to be the main body.
    """
    moments = np.linspace(0, len(motion.times) - 1, min(poses, len(motion.times))).astype(int)
    seen = rhythm.at(motion.times[moments])
    found = []
    for mirrored, sign in ((False, 1.0), (True, -1.0)):
        turned = sign * seen + (math.pi if mirrored else 0.0)
        places = motion.parts[:, :, [X, Y]][moments] * (sign, 1.0)
        for order in correspondences(body, places, main_known):
            rolls = on_branch(body, turned, order)
            upright = abs(float(rolls[:, order[0]].mean()) - root_roll(body)) <= math.pi / 2
            likened = proportioned(body, motion.parts[:, order], bounds)
            misplaced = misplacement(likened, rolls[:, order], places[:, order])
            read = rhythm.read(sign, rolls[0] - sign * seen[0])
            found.append((not upright, misplaced, Reading(mirrored, order, read, likened, misplaced)))
    return [reading for *_, reading in sorted(found, key=lambda rated: rated[:2])]


def proportioned(body: Morphology, parts: Vector, bounds: tuple[float, float]) -> Morphology:
    """The body with its limbs as long, beside its main body, as a teacher's are: "structurally similar" is not alike.

    Args:
        body: The self-model.
        parts: (F, k, 8) the teacher's parts in the student's order.
        bounds: A limb grows by no factor outside these.
    """
    lengths = length_ratios(body, parts)
    names = list(body.parts)
    factors = dict(zip(names, np.clip(lengths / lengths[names.index(body.root)], *bounds), strict=True))
    changes: dict[str, dict[str, object]] = {}
    for name, part in body.parts.items():
        if name != body.root and isinstance(part, CappedCylinder):
            changes[name] = {"length": part.length * float(factors[name])}
    return body.varied(parts=changes)


def length_ratios(body: Morphology, parts: Vector) -> Vector:
    """(k,) how many times as long as the student's parts the teacher's (F, k, 8) are, in the student's order."""
    ratios = []
    for part, seen in zip(body.parts.values(), np.median(parts, axis=0), strict=True):
        length = {CUBOID: seen[D1], SPHERE: 2 * seen[D1]}.get(int(seen[SHAPE]), seen[D2])
        ratios.append(max(float(length), 1e-3) / part.length_along_x)
    return np.array(ratios)


def correspondences(body: Morphology, places: Vector, main_known: bool = True) -> list[NDArray[np.int64]]:
    """Section 3.4.2: assignments of objects at places (poses, k, 2) to the student's parts.

    Every one for up to four limbs; for more of them only the nearest by normalised positions to the flat body. With
    ``main_known`` the first object is the main body; otherwise any may be, as in the paper.
    """
    count = places.shape[1]
    if not main_known and count <= _MOST_LIMBS:
        return [np.array(order, dtype=np.int64) for order in itertools.permutations(range(count))]
    if count <= _MOST_LIMBS + 1:
        return [np.array((0, *rest), dtype=np.int64) for rest in itertools.permutations(range(1, count))]
    gaps = normalised(view_of(body)[1])[1:, None] - normalised(np.median(places, axis=0))[None, 1:]
    _, limbs = linear_sum_assignment(np.linalg.norm(gaps, axis=2))
    return [np.concatenate([[0], limbs + 1]).astype(np.int64)]


def misplacement(body: Morphology, rolls: Vector, places: Vector) -> float:
    """How far a teacher's parts are from where the student's would be in the same postures.

    Section 3.4.2 compares normalised positions with those of the flat self-model, but a body that moves is not
    flat. Here the self-model takes the posture that the rolls tell of, at every moment.

    Args:
        body: The self-model.
        rolls: (poses, k) of the parts in the student's order, rad.
        places: (poses, k, 2) of their centres, x right and y down, m.

    Returns:
        Root mean square distance after the best shift of each pose and one common scale, as a share of the root
        mean square extent of what was seen: 0 is perfect, 1 no better than a point.
    """
    right, _ = view_of(body)
    own = np.empty_like(places)
    turns = rolls[:, 0] - root_roll(body)
    for pose, (turn, angles) in enumerate(zip(turns, joint_angles(body, rolls), strict=True)):
        centres = np.array([part[:3, 3] for part in body.poses(angles).values()])
        x, y = centres @ right, -centres[:, 2]
        own[pose, :, 0] = x * math.cos(turn) - y * math.sin(turn)
        own[pose, :, 1] = x * math.sin(turn) + y * math.cos(turn)
    own -= own.mean(axis=1, keepdims=True)
    seen = places - places.mean(axis=1, keepdims=True)
    scale = max(0.0, float(np.sum(own * seen)) / max(float(np.sum(own**2)), 1e-12))
    return float(np.sqrt(np.sum((seen - scale * own) ** 2) / max(float(np.sum(seen**2)), 1e-12)))


def on_branch(body: Morphology, rolls: Vector, order: NDArray[np.int64]) -> Vector:
    """Rolls (samples, k) shifted by whole turns: the main body's to where it lies flat, each limb's about its parent's.

    Rolls that mean the same must be the same numbers to a network.
    """
    shifted, names = rolls.copy(), list(body.parts)
    root = order[names.index(body.root)]
    shifted[:, root] -= _TURN * np.round((shifted[:, root].mean() - root_roll(body)) / _TURN)
    pending = list(body.joints.values())
    done = {body.root}
    while pending:
        joint = pending.pop(0)
        if joint.parent not in done:
            pending.append(joint)
            continue
        child, parent = order[names.index(joint.child)], order[names.index(joint.parent)]
        flat = 0.0 if math.cos(math.radians(joint.angle_deg)) >= 0 else math.pi
        apart = float(np.mean(shifted[:, child] - shifted[:, parent])) - flat
        shifted[:, child] -= _TURN * np.round(apart / _TURN)
        done.add(joint.child)
    return shifted


def wrapped(angles: Vector) -> Vector:
    """Angles (rad) within half a turn of zero."""
    return np.asarray((angles + math.pi) % (2 * math.pi) - math.pi)
