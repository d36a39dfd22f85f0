"""When a motion that is tried need not be seen to its end: the error of Eq. 5 only grows."""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.imagination import Enough
from testbed.student.moving._gaps import gap
from testbed.student.moving.rolls import RollReading

_SURELY = 1 + 1e-6
"""Rounding must not decide who is beaten."""


class Beaten:
    """Tells, while a body moves, when its error has grown beyond one that is to be beaten.

    Args:
        body: Whose motions are tried.
        right: (3,) the world direction that is to the right.
        wanted: (samples, k) rolls of its parts that are wanted, rad.
        reading: How rolls are read. Unwrapped ones depend on each other: then nobody is beaten before the end.
    """

    def __init__(self, body: Morphology, right: Vector, wanted: Vector, reading: RollReading) -> None:
        slots = {body.root: 0, **{joint.child: place + 1 for place, joint in enumerate(body.joints.values())}}
        names, joints = list(body.parts), list(body.joints.values())
        tree: list[tuple[int, int, int]] = []
        reached = {body.root}
        while len(tree) < len(joints):
            for number, joint in enumerate(joints):
                if joint.parent in reached and joint.child not in reached:
                    tree.append((number, slots[joint.parent], slots[joint.child]))
                    reached.add(joint.child)
        mounts = np.array([body.mount(joint)[:3, :3] for joint in joints])
        self._body = (np.array(tree, dtype=np.int64).reshape(-1, 3), mounts.reshape(-1, 3, 3))
        self._right = np.asarray(right, dtype=float)
        self._wanted = np.ascontiguousarray(wanted[:, [names.index(slot) for slot in slots]])
        self._reading = reading

    def by(self, error: float) -> Enough:
        """For one motion: does it do worse than an error, Eq. 5, rad?"""
        if self._reading == "unwrapped":
            return lambda step, bases, joints: False
        half = math.pi if self._reading == "raw" else math.pi / 2
        (tree, mounts), right, wanted = self._body, self._right, self._wanted
        total, most = 0.0, error**2 * _SURELY

        def enough(step: int, bases: Vector, joints: Vector) -> bool:
            nonlocal total
            total += gap(bases[step], joints[step], tree, mounts, right, wanted[step], half)
            return total > most

        return enough
