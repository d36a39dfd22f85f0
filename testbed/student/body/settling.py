"""Where a body comes to rest, quickly: the quasi-static stand-in for a physical simulation (Section 3.2.2).

The paper simulates every self-model; a settled tilt needs far less: a stiff posture rolls over its support edges until
its centre of mass is supported. Friction and inertia play no part, so a body that a swift motion would throw over,
or one that has several ways to lie, may end otherwise than in the simulation: about one pose in twenty.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import CappedCylinder, Cuboid, Morphology, Part, Vector
from testbed.student.body._postures import BALL, CAPPED, CUBOID, Indices
from testbed.student.body._settling import settle_commands
from testbed.student.body.servos import Servos

INCREMENT = math.radians(10.0)
"""The fastest motor turns this far between two rests on the way to a command. Agreement is alike from 3 to 30 deg."""


LEVEL = np.array([0.0, 0.0, 1.0])
"""The world's up in the frame of a root that lies as it was put down."""


def shape_row(part: Part) -> tuple[float, float, float, float]:
    """Kind and sizes of a part, as the compiled code takes them."""
    if isinstance(part, Cuboid):
        return (CUBOID, *part.size)
    if isinstance(part, CappedCylinder):
        return (CAPPED, part.radius, part.length, 0.0)
    return (BALL, part.radius, 0.0, 0.0)


def parents_first(parents: Indices) -> Indices:
    """The limbs in an order in which none comes before the part that it hangs on.

    Args:
        parents: (n,) the part (0 the main body, i + 1 limb i) on which each limb hangs.

    Raises:
        ValueError: If they make no tree.
    """
    order: list[int] = []
    placed = {0}
    while len(order) < len(parents):
        ready = [i for i, parent in enumerate(parents) if i + 1 not in placed and int(parent) in placed]
        if not ready:
            raise ValueError(f"the limbs make no tree: {parents.tolist()}")
        order += ready
        placed.update(i + 1 for i in ready)
    return np.array(order, dtype=np.int64)


class Settler:
    """A body that comes to rest after motor commands.

    Args:
        body: The body.
        increment: How far the fastest motor turns between two rests, rad.
    """

    def __init__(self, body: Morphology, *, increment: float = INCREMENT) -> None:
        joints = list(body.joints.values())
        parts = [body.root, *(joint.child for joint in joints)]
        parents = np.array([parts.index(joint.parent) for joint in joints], dtype=np.int64)
        mounts = np.empty((len(joints), 5))
        for row, joint in zip(mounts, joints, strict=True):
            pose = body.mount(joint)
            row[:] = *pose[:3, 3], pose[0, 0], pose[1, 0]
        speeds = np.array([joint.speed_deg for joint in joints])
        self._rest, self._speeds = body.rest, np.radians(speeds)
        self.joints = len(joints)
        self._body = (
            parents,
            parents_first(parents),
            mounts,
            np.array([shape_row(body.parts[part]) for part in parts], dtype=float),
            np.array([body.parts[part].mass for part in parts]),
            speeds / speeds.max(initial=1e-9),
        )
        self._increment = increment

    def settle(self, commands: Vector) -> Vector:
        """Rest after each command, started flat, the root's x axis along the world's.

        Args:
            commands: (n, joints) joint angles, rad.

        Returns:
            (n, 7) position (m) and quaternion xyzw of the root.
        """
        return _bases(self._poses(commands, afresh=True))

    def tilt(self, commands: Vector) -> Vector:
        """(n, 2) tilt of the root (rad) after each command, as :func:`testbed.physics.tilt_of`."""
        return tilt_of_up(self._poses(commands, afresh=True)[:, :3])

    def stays(self, commands: Vector, up: Vector) -> Vector:
        """(n, 3) the up direction to which a stiff posture rolls, the joints at ``commands`` (n, joints) rad all along.

        Args:
            commands: Joint angles.
            up: (n, 3) where it is put down: the world's up in the root's frame.
        """
        poses = np.empty((len(commands), 10))
        targets, starts = (np.ascontiguousarray(each, dtype=float) for each in (commands, up))
        settle_commands(*self._body, targets, self._increment, starts, True, poses)
        return poses[:, :3]

    def follow(self, targets: Vector, servos: Servos | None = None) -> tuple[Vector, Vector]:
        """A slow motion: each step starts where the one before came to rest, the first flat.

        What touches the ground while the body rolls stays where it is; slipping is not foreseen, so that places on
        the ground are rough.

        Args:
            targets: (steps, joints) joint angles, rad.
            servos: What moves the joints; None if each step lasts until they are where they are asked to be.

        Returns:
            Base (steps, 7) and joints (steps, joints), as :func:`testbed.student.moving.rolls.headings` takes them.
        """
        joints = np.array(targets, dtype=float)
        if servos is not None:
            joints = servos.angles(joints, self._rest, self._speeds)
        return _bases(self._poses(joints, afresh=False)), joints

    def _poses(self, targets: Vector, *, afresh: bool) -> Vector:
        targets = np.ascontiguousarray(targets, dtype=float)
        poses = np.empty((len(targets), 10))
        starts = np.tile(LEVEL, (len(targets) if afresh else 0, 1))
        settle_commands(*self._body, targets, self._increment, starts, False, poses)
        return poses


def tilt_of_up(up: Vector) -> Vector:
    """(n, 2) tilt (rad) where the world's up direction is (n, 3) in the root's frame."""
    return np.stack(
        [np.arctan2(up[:, 1], up[:, 2]), np.arctan2(-up[:, 0], np.hypot(up[:, 1], up[:, 2]))], axis=1
    )


def up_of_tilt(tilt: Vector) -> Vector:
    """(n, 3) the world's up direction in the root's frame, from (n, 2) tilt (rad)."""
    side, nose = np.asarray(tilt, dtype=float).T
    return np.stack([-np.sin(nose), np.cos(nose) * np.sin(side), np.cos(nose) * np.cos(side)], axis=1)


def _bases(poses: Vector) -> Vector:
    if not len(poses):
        return np.empty((0, 7))
    up, ahead = poses[:, :3], poses[:, 3:6]
    matrices = np.stack([ahead, np.cross(up, ahead), up], axis=1)
    # They are square to 1e-15; that SciPy makes sure of it takes as long as all the rolling.
    turns = Rotation.from_matrix(matrices, assume_valid=True)
    return np.concatenate([poses[:, 6:9], turns.as_quat()], axis=1)
