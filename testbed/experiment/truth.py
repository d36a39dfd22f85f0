"""The truth, and how far the student's beliefs are from it: *objective errors*, computed outside the student.

The paper sets them apart from the *subjective* errors that the student can know (Section 4) without saying how they
are measured; each function below says how it is done here.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import CappedCylinder, Cuboid, Joint, Mesh, Morphology, Part, Sphere, Vector
from testbed.student.moving.rolls import headings, read_rolls, roll_of
from testbed.vision.camera import StereoRig
from testbed.vision.kernel import render
from testbed.vision.primitives import CAPPED_CYLINDER, CUBOID, OMEGA, SPHERE, X, Z

WHITE = 255
_POSTURES = (-60.0, 0.0, 60.0)
"""Degrees of each joint in the postures in which self-models are compared."""
_MOST_POSTURES = 81
_MOVES = 10.0
"""A joint whose travel (degrees) is smaller than this does not move its limb: the two are one stiff part."""


def is_like(student: Morphology, teacher: Morphology) -> bool:
    """Whether a teacher is appropriate: the same parts joined in the same way, whatever its size.

    Parts are compared by their place in the tree and their shape, mounting angles after rounding to a degree, where a
    hinge sits beside the middle by tenths of the part that carries it, joints by whether they move at all.
    """
    return _plan(student) == _plan(teacher)


def _plan(body: Morphology) -> tuple[object, ...]:
    def branch(part: str) -> tuple[object, ...]:
        limbs = sorted(
            (*_place(joint, body.parts[part]), _moves(joint), branch(joint.child))
            for joint in body.joints.values()
            if joint.parent == part
        )
        return (body.parts[part].shape, *limbs)

    return branch(body.root)


def _place(joint: Joint, parent: Part) -> tuple[float, ...]:
    """Where a hinge sits on its parent, whatever the size: lengths in tenths of the parent's."""
    if joint.frame is not None:
        x, y, z, *turn = joint.frame
        lengths = (round(10 * length / parent.length_along_x) for length in (x, y, z))
        return (*lengths, *(round(math.degrees(angle)) for angle in turn))
    lengths = (round(10 * length / parent.length_along_x) for length in (joint.across, joint.height))
    return (round(joint.angle_deg) % 360, round(joint.along, 2), *lengths)


def _moves(joint: Joint) -> bool:
    low, high = joint.limits_deg
    return high - low >= _MOVES


def self_model_error(believed: Morphology, true: Morphology) -> float:
    """How far a self-model's parts are from where they really are, in metres.

    The mean distance between the centres of believed and true limbs in the frame of the main body, over all postures
    with each joint at -60, 0 or 60 degrees (of more than 81 an even choice); limbs are matched by the motor that moves
    them.
    """
    distances = []
    for posture in _postures(len(true.joints)):
        pairs = zip(
            _limb_centres(believed, posture),
            _limb_centres(true, posture),
            strict=True,
        )
        distances += [float(np.linalg.norm(ours - theirs)) for ours, theirs in pairs]
    return float(np.mean(distances))


def _postures(joints: int) -> Vector:
    count = len(_POSTURES) ** joints
    stride = 1 if count <= _MOST_POSTURES else count // _MOST_POSTURES + 1
    chosen = np.arange(min(count, _MOST_POSTURES)) * stride % count
    digits = chosen[:, None] // len(_POSTURES) ** np.arange(joints)[::-1] % len(_POSTURES)
    return np.asarray(np.radians(np.array(_POSTURES)[digits]))


def _limb_centres(body: Morphology, posture: Vector) -> list[Vector]:
    poses = body.poses(posture)
    return [poses[joint.child][:3, 3] for joint in body.joints.values()]


def in_motor_order(body: Morphology) -> list[int]:
    """The places of a body's parts, main body first and limbs in motor order: as the student's own parts are."""
    names = list(body.parts)
    return [names.index(body.root), *(names.index(joint.child) for joint in body.joints.values())]


def parts_in_view(body: Morphology, base: Vector, joints: Vector, *, eye_height: float, pan: float) -> Vector:
    """A body's true parts as the rig would describe them: (parts, 8) like Eq. 2, metres and rad, rig frame.

    Args:
        body: The body.
        base: (7,) position and quaternion xyzw of its root in the world.
        joints: Joint angles, rad.
        eye_height: Height of the rig above the ground, m.
        pan: Direction in which the rig looks, rad.

    Where nobody knows the base, nobody knows the parts: all NaN.
    """
    if np.isnan(base).any():
        return np.full((len(body.parts), 8), math.nan)
    right = np.array([math.cos(pan), -math.sin(pan), 0.0])
    forward = np.array([math.sin(pan), math.cos(pan), 0.0])
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = Rotation.from_quat(base[3:]).as_matrix(), base[:3]
    directions = headings(body, base[None], joints[None])[0]
    described = []
    for (name, pose), heading in zip(body.poses(joints).items(), directions, strict=True):
        part = body.parts[name]
        middle = np.mean(part.box, axis=0) * part.factor if isinstance(part, Mesh) else np.zeros(3)
        centre = (root @ pose @ [*middle, 1.0])[:3]
        roll = float(roll_of(heading, right))
        shape, sizes = _shape_and_sizes(part)
        described.append([shape, centre @ right, eye_height - centre[2], centre @ forward, roll, *sizes])
    return np.array(described)


def _shape_and_sizes(part: Part) -> tuple[int, tuple[float, float, float]]:
    if isinstance(part, Cuboid):
        return CUBOID, part.size
    if isinstance(part, Mesh):
        return CUBOID, part.size
    if isinstance(part, Sphere):
        return SPHERE, (part.radius, 0.0, 0.0)
    assert isinstance(part, CappedCylinder)
    return CAPPED_CYLINDER, (part.radius, part.length, 0.0)


def teacher_model_error(model: Vector, true: Vector) -> tuple[float, float]:
    """How far a teacher model's objects are from the true parts.

    Args:
        model: (k, 8) objects.
        true: (n, 8) parts at the moment that the image was taken.

    Returns:
        Mean distance of centres (m) and of rolls (rad, modulo half a turn) under the assignment of objects to
        parts with the smallest total distance.
    """
    gaps = np.linalg.norm(model[:, None, X : Z + 1] - true[None, :, X : Z + 1], axis=2)
    if np.isnan(gaps).any():
        return math.nan, math.nan
    rows, columns = linear_sum_assignment(gaps)
    turned = read_rolls((model[rows, OMEGA] - true[columns, OMEGA])[None], "half_turn")
    return float(gaps[rows, columns].mean()), float(np.abs(turned).mean())


def overlap(model: Vector, true: Vector, rig: StereoRig) -> float:
    """How much of what either shows is shown by both: intersection over union of silhouettes, both eyes, 0 to 1.

    Args:
        model: (k, 8) objects.
        true: (n, 8) parts.
        rig: The eyes that see them.
    """
    if np.isnan(true).any():
        return math.nan
    believed, real = render(model, rig) < WHITE, render(true, rig) < WHITE
    return float((believed & real).sum() / max(int((believed | real).sum()), 1))


def controller_error(response: Vector, true_rolls: Vector) -> float:
    """How far the self-model's rolls are from those of the teacher's true parts, rms rad.

    Args:
        response: (samples, k) rolls of the self-model under a controller, main body and limbs in motor order.
        true_rolls: (looks, k) true rolls of the teacher's parts at each look, likewise ordered; each look stands for
            an equal share of the samples, as in the teacher's roll history.
    """
    shown = np.repeat(true_rolls, len(response) // len(true_rolls), axis=0)
    gaps = read_rolls(response[: len(shown)] - shown, "half_turn")
    return float(np.sqrt(np.mean(gaps**2)))
