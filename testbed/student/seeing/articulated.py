"""Bodies of hinged or free parts, laid into the stereo silhouettes of many frames at once.

One engine for every hypothesis about a candidate (an extension of Section 3.3.2: there a teacher model is made anew
for each look; here sizes, depth and the plane of motion are shared by all frames, only the pose differs).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Cuboid, Part, Sphere, Vector
from testbed.student.seeing._plan import (
    ALONG,
    DEPTH,
    LENGTH,
    SCALE,
    THICKNESS,
    TURN,
    UP,
    YAW,
    Eyes,
    Plan,
    place_parts,
)
from testbed.vision.camera import StereoRig
from testbed.vision.silhouette import camera_of

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Limb:
    """One part of a body plan.

    Attributes:
        part: Shape and size at scale one.
        parent: The part that it hangs on; None if it is free.
        place: Where its hinge sits in the parent's frame at scale one, (x, y, z) m.
        mount: Mounting angle about the parent's own z, rad.
        frozen: Its hinge does not move: one angle for all frames.
        long: Its length is a number of its own.
        thick: So is its thickness (height of a cuboid, radius of others).
    """

    part: Part
    parent: int | None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mount: float = 0.0
    frozen: bool = False
    long: bool = True
    thick: bool = False


@dataclass(frozen=True)
class Body:
    """A body plan with the layout of its numbers: x = (pose (m), shared (q)).

    Attributes:
        limbs: The parts, each after what it hangs on.
        facing: 1 or -1.
        plan: The same as arrays.
        pose: m, how many numbers a frame has of its own.
        names: (m + q) what each number is: "along", "up", "turn", "scale", "depth", "yaw", "length", "thickness".
        owners: (m + q) which part it belongs to, -1 for all.
    """

    limbs: tuple[Limb, ...]
    facing: int
    plan: Plan
    pose: int
    names: tuple[str, ...]
    owners: tuple[int, ...]

    @property
    def shared(self) -> int:
        """q, how many numbers all frames share."""
        return len(self.names) - self.pose

    @property
    def everything(self) -> int:
        """The bit set of all parts."""
        return (1 << len(self.limbs)) - 1

    def find(self, name: str, owner: int = -1) -> int:
        """Where x holds a number; -1 if it has none such."""
        for i, key in enumerate(zip(self.names, self.owners, strict=True)):
            if key == (name, owner):
                return i
        return -1

    def facing_other_way(self) -> Body:
        """The same body, turned by half a turn about the vertical."""
        return replace(self, facing=-self.facing, plan=self.plan._replace(facing=-self.plan.facing))


def _size(part: Part) -> tuple[float, float, float]:
    if isinstance(part, Cuboid):
        return part.size
    if isinstance(part, Sphere):
        return part.radius, 0.0, 0.0
    return part.radius, part.length, 0.0


def lay_out(limbs: tuple[Limb, ...], facing: int = 1) -> Body:
    """Give every number of a body plan its place in x."""
    own: list[tuple[str, int]] = []
    shared: list[tuple[str, int]] = [("scale", -1), ("depth", -1), ("yaw", -1)]
    for i, limb in enumerate(limbs):
        if limb.parent is None:
            own += [("along", i), ("up", i)]
        (shared if limb.frozen else own).append(("turn", i))
        shared += [("length", i)] * limb.long + [("thickness", i)] * limb.thick
    order = own + shared
    at = {key: i for i, key in enumerate(order)}
    index = np.full((len(limbs), 5), -1, np.int64)
    columns = {"along": ALONG, "up": UP, "turn": TURN, "length": LENGTH, "thickness": THICKNESS}
    for (name, owner), i in at.items():
        if owner >= 0:
            index[owner, columns[name]] = i
    common = np.zeros(3, np.int64)
    common[[SCALE, DEPTH, YAW]] = at["scale", -1], at["depth", -1], at["yaw", -1]
    shapes = {"cuboid": 0, "sphere": 1, "capped_cylinder": 2}
    plan = Plan(
        shape=np.array([shapes[limb.part.shape] for limb in limbs], np.int64),
        parent=np.array([-1 if limb.parent is None else limb.parent for limb in limbs], np.int64),
        size=np.array([_size(limb.part) for limb in limbs], float),
        place=np.array([limb.place for limb in limbs], float),
        mount=np.array([limb.mount for limb in limbs], float),
        where=index,
        common=common,
        facing=float(facing),
    )
    names, owners = zip(*order, strict=True)
    return Body(limbs, facing, plan, len(own), names, owners)


def eyes_of(alpha: NDArray[np.float32], rig: StereoRig, unseen: NDArray[np.bool_] | None = None) -> Eyes:
    """What was seen, (F, 2, height, width) darkness, and where nothing is known, as the compiled functions take it."""
    alpha = np.ascontiguousarray(alpha, np.float32)
    blank = np.square(alpha, dtype=np.float64).sum((1, 2, 3))
    if unseen is not None:
        alpha = np.where(unseen, np.float32(-1), alpha)
    return Eyes(alpha, blank, np.array(rig.eyes), camera_of(rig))


def describe(body: Body, x: Vector) -> Vector:
    """(F, k, 8) the parts as objects of Eq. 2 in the rig's frame, from the numbers x (F, m + q)."""
    k = len(body.limbs)
    out = np.zeros((len(x), k, 8))
    centre, axes, size = np.empty((k, 3)), np.empty((k, 3, 3)), np.empty((k, 3))
    for row, numbers in zip(out, np.ascontiguousarray(x), strict=True):
        place_parts(body.plan, numbers, centre, axes, size)
        row[:, 0] = body.plan.shape
        row[:, 1:4] = centre
        row[:, 4] = np.arctan2(axes[:, 0, 1], axes[:, 0, 0])
        row[:, 5:] = size
    return out
