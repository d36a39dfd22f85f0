"""Rolls: how far a part is turned about the line of sight (Section 3.4.1), in a body and in a teacher model."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import Morphology, Vector

RollReading = Literal["half_turn", "raw", "unwrapped"]


def headings(body: Morphology, bases: Vector, joints: Vector) -> Vector:
    """Where each part's x axis points in the world.

    Args:
        body: The body.
        bases: (steps, 7) position and quaternion xyzw of the root.
        joints: (steps, joints) joint angles, rad.

    Returns:
        (steps, parts, 3) unit vectors.
    """
    frames = {body.root: Rotation.from_quat(bases[:, 3:]).as_matrix()}
    pending = list(enumerate(body.joints.values()))
    while pending:
        index, joint = pending.pop(0)
        if joint.parent not in frames:
            pending.append((index, joint))
            continue
        mount = body.mount(joint)[:3, :3]
        turns = _turns(joints[:, index])
        frames[joint.child] = frames[joint.parent] @ mount @ turns
    return np.stack([frames[part][:, :, 0] for part in body.parts], axis=1)


def _turns(angles: Vector) -> Vector:
    """(n, 3, 3) turns about y by angles (n,), rad: see :func:`testbed.frames.rotation_y`."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 1, 1] = 1.0
    listed = angles.tolist()  # math, not NumPy, whose last bit depends on the processor
    turns[:, 0, 0] = turns[:, 2, 2] = [math.cos(angle) for angle in listed]
    turns[:, 0, 2] = [math.sin(angle) for angle in listed]
    turns[:, 2, 0] = -turns[:, 0, 2]
    return turns


def roll_of(headings: Vector, right: Vector) -> Vector:
    """Roll (rad) of x axes (..., 3) for a viewer whose image has ``right`` (3,) to the right; positive is down."""
    return np.arctan2(-headings[..., 2], headings @ right)


def read_rolls(rolls: Vector, reading: RollReading) -> Vector:
    """Rolls (steps, k) of parts that look the same after half a turn; see ``ImitationParameters.roll_reading``."""
    if reading == "raw":
        return rolls
    if reading == "unwrapped":
        return np.unwrap(rolls, axis=0, period=math.pi)
    return (rolls + math.pi / 2) % math.pi - math.pi / 2


def view_of(body: Morphology) -> tuple[Vector, Vector]:
    """How the student looks at its self-model: "the main body to the extreme left, l_b to the extreme right".

    Returns:
        right (3,): the world direction that is to the right when the body was put down flat with yaw zero;
        places (k, 2): the flat parts' positions in that view, x right and y down, in metres.
    """
    flat = body.poses(np.zeros(len(body.joints)))
    centres = np.array([pose[:3, 3] for pose in flat.values()])
    last = centres[-1] - centres[0]
    yaw = math.atan2(last[1], last[0]) if np.hypot(*last[:2]) > 1e-6 else 0.0
    right = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    return right, np.stack([centres @ right, -centres[:, 2]], axis=1)
