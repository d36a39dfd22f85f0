"""Robots of URDF files as bodies of ours.

Links that cannot turn against each other become one part, and so do those that only slide: a part moves by hinges or
not at all. A part's frame sits in the hinge that carries it (the root's in its centre of mass), its y axis is the
hinge's, its x axis points along the part. Mass is as the file tells it, and spread evenly.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from testbed.bodies.meshes import Shape, shape_of_pieces
from testbed.bodies.morphology import Joint, Morphology
from testbed.bodies.parts import Mesh, Vector
from testbed.bodies.urdf_reading import TURNING, Geometry, UrdfFile, UrdfJoint, read_urdf_file
from testbed.errors import UserError

_DENSITY = 600.0  # kg/m3 of a robot whose file tells no masses
_DENSEST = 30_000.0
_TORQUE, _SPEED_DEG = 1.2, 300.0  # a hobby servo's, where the file tells none
_HALF_TURN = 180.0


@dataclass(frozen=True)
class _Rigid:
    """Links that are one piece: the pose (4, 4) of each in the first one's frame."""

    links: dict[str, Vector]


@dataclass(frozen=True)
class _Assembly:
    """A URDF as a tree of parts.

    Attributes:
        file: What it says.
        rigid: Its parts, by the name of their first link.
        turning: The joint that carries each part but the root, by the part.
        frames: (4, 4) of each part's own frame in the frame of its first link.
    """

    file: UrdfFile
    rigid: dict[str, _Rigid]
    turning: dict[str, UrdfJoint]
    frames: dict[str, Vector]


def read_urdf(path: Path) -> Morphology:
    """The body that a URDF describes.

    Raises:
        UserError: If it cannot be read, its links are no tree, or a part has no shape.
    """
    state = path.stat() if path.is_file() else None
    return _read(path, *((state.st_mtime_ns, state.st_size) if state else (0, 0)))


def link_shape(path: Path, link: str) -> Shape:
    """What is seen and felt of a part of a URDF's body, in the part's frame."""
    state = path.stat()
    return _shape(path, state.st_mtime_ns, state.st_size, link)


@functools.lru_cache(maxsize=32)
def _read(path: Path, changed: int, size: int) -> Morphology:
    assembly = _assembled(path, changed, size)
    names = {link: _plain_name(link) for link in assembly.rigid}
    parts = {names[link]: _part(path, changed, size, link, assembly) for link in assembly.rigid}
    joints = {
        _plain_name(joint.name): _hinge(joint, link, names, assembly)
        for link, joint in assembly.turning.items()
    }
    if len(parts) < len(assembly.rigid) or len(joints) < len(assembly.turning):
        raise UserError("two links or joints have one name", "rename one of them", file=path)
    name = _plain_name(assembly.file.name)
    return Morphology(name=name, description=f"from {path.name}", parts=parts, joints=joints)


@functools.lru_cache(maxsize=32)
def _assembled(path: Path, changed: int, size: int) -> _Assembly:
    file = read_urdf_file(path)
    carried = {joint.child: joint for joint in file.joints}
    if len(carried) < len(file.joints):
        raise UserError("a link hangs on two joints", "a body must be a tree", file=path)
    roots = [link for link in file.links if link not in carried]
    if len(roots) != 1:
        raise UserError(f"{len(roots)} links hang on no joint", "it must be exactly one", file=path)
    rigid = {roots[0]: _Rigid({roots[0]: np.eye(4)})}
    turning: dict[str, UrdfJoint] = {}
    of = {roots[0]: roots[0]}
    pending = list(file.joints)
    while pending:
        known = [joint for joint in pending if joint.parent in of]
        if not known:
            raise UserError("some joints form a ring", "every link must lead to the root", file=path)
        for joint in known:
            pending.remove(joint)
            link = file.links[joint.child]
            if joint.kind in TURNING and (link.visuals or link.collisions):
                rigid[joint.child] = _Rigid({joint.child: np.eye(4)})
                turning[joint.child], of[joint.child] = joint, joint.child
            else:
                first = of[joint.child] = of[joint.parent]
                rigid[first].links[joint.child] = rigid[first].links[joint.parent] @ joint.pose
    frames = {}
    for first, group in rigid.items():
        pieces = _pieces(file, group, np.eye(4))
        if not pieces:
            mend = "give it a visual or a collision"
            raise UserError(f"link '{first}' has no shape that can be read", mend, file=path)
        centre = shape_of_pieces(pieces, pieces, whole=True).centre
        frames[first] = _frame(turning.get(first), centre)
    return _Assembly(file, rigid, turning, frames)


def _frame(joint: UrdfJoint | None, centre: Vector) -> Vector:
    """A part's frame in its first link's frame; the hinge is at that link's origin."""
    frame = np.eye(4)
    if joint is None:
        frame[:3, 3] = centre
        return frame
    y = joint.axis
    along = centre - (centre @ y) * y
    if np.linalg.norm(along) < 1e-6:
        along = np.cross(y, np.eye(3)[int(np.argmin(np.abs(y)))])
    x = along / np.linalg.norm(along)
    frame[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
    return frame


def _pieces(
    file: UrdfFile, group: _Rigid, frame: Vector, *, felt: bool = False
) -> list[tuple[Geometry, Vector]]:
    """What is seen (or felt, if anything is told of it) of a part, each piece with its pose in the part's frame."""
    inverse = np.linalg.inv(frame)

    def of(kinds: list[str]) -> list[tuple[Geometry, Vector]]:
        return [
            (piece, inverse @ pose @ piece.pose)
            for link, pose in group.links.items()
            for piece in getattr(file.links[link], kinds[0])
        ]

    seen, touched = of(["visuals"]), of(["collisions"])
    return (touched or seen) if felt else (seen or touched)


@functools.lru_cache(maxsize=256)
def _shape(path: Path, changed: int, size: int, link: str) -> Shape:
    assembly = _assembled(path, changed, size)
    group, frame = assembly.rigid[link], assembly.frames[link]
    return shape_of_pieces(
        _pieces(assembly.file, group, frame), _pieces(assembly.file, group, frame, felt=True)
    )


def _part(path: Path, changed: int, size: int, link: str, assembly: _Assembly) -> Mesh:
    shape = _shape(path, changed, size, link)
    links = [assembly.file.links[name] for name in assembly.rigid[link].links]
    mass = sum(one.mass for one in links)
    shown = [one.grey for one in links if one.visuals]
    return Mesh(
        urdf=str(path),
        link=link,
        density=min(mass / shape.volume, _DENSEST) if mass else _DENSITY,
        luminosity=round(float(np.mean(shown))) if shown else 110,
        solid=shape.volume,
        centre=_triple(shape.centre) if link in assembly.turning else (0.0, 0.0, 0.0),
        moments=_triple(shape.moments),
        box=(_triple(shape.points.min(axis=0)), _triple(shape.points.max(axis=0))),
    )


def _hinge(joint: UrdfJoint, link: str, names: dict[str, str], assembly: _Assembly) -> Joint:
    parent = next(first for first, group in assembly.rigid.items() if joint.parent in group.links)
    in_parent = assembly.rigid[parent].links[joint.parent] @ joint.pose @ assembly.frames[link]
    pose = np.linalg.inv(assembly.frames[parent]) @ in_parent
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    low, high = (min(max(math.degrees(limit), -_HALF_TURN), _HALF_TURN) for limit in joint.limits)
    if joint.kind == "continuous" or low >= high:
        low, high = -_HALF_TURN, _HALF_TURN
    return Joint(
        parent=names[parent],
        child=names[link],
        frame=(*_triple(pose[:3, 3]), *_triple(turn)),
        limits_deg=(low, high),
        torque=min(joint.effort, 1000.0) or _TORQUE,
        speed_deg=min(math.degrees(joint.velocity), 3600.0) or _SPEED_DEG,
    )


def _triple(vector: Vector) -> tuple[float, float, float]:
    x, y, z = (float(number) for number in vector)
    return x, y, z


def _plain_name(name: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_-]", "_", name)
    return plain if re.match(r"[A-Za-z]", plain) else f"robot_{plain}"
