"""URDF files from elsewhere, as they are written: links with their shapes, joints with their frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from testbed.bodies.parts import Vector
from testbed.bodies.xml_reading import Element, read_xml
from testbed.errors import UserError
from testbed.frames import translation

TURNING = ("revolute", "continuous")
_KINDS = (*TURNING, "fixed", "prismatic", "planar", "floating")
_GREY = 110
_LUMINANCE = (0.299, 0.587, 0.114)
_SCHEMES = ("package://", "model://", "file://")


@dataclass(frozen=True)
class Geometry:
    """A shape in its link's frame.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere``, ``capsule`` or ``mesh``.
        sizes: In metres: three sides; radius and length along z; radius; radius and length; factors of a mesh.
        file: Of a mesh.
        pose: (4, 4) in the link's frame.
    """

    kind: str
    sizes: tuple[float, ...]
    file: Path | None
    pose: Vector


@dataclass(frozen=True)
class Link:
    """A rigid piece: its mass in kg (0 if not told), what is seen and felt of it, and its mean grey level."""

    mass: float
    visuals: tuple[Geometry, ...]
    collisions: tuple[Geometry, ...]
    grey: int


@dataclass(frozen=True)
class UrdfJoint:
    """How one link hangs on another; limits in rad, effort in N m, velocity in rad/s, 0 where not told."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Vector
    axis: Vector
    limits: tuple[float, float]
    effort: float
    velocity: float


@dataclass(frozen=True)
class UrdfFile:
    """What a URDF says."""

    name: str
    links: dict[str, Link]
    joints: tuple[UrdfJoint, ...]


def read_urdf_file(path: Path) -> UrdfFile:
    """Read a URDF.

    Raises:
        UserError: If it is none, with the line of the mistake.
    """
    root = read_xml(path)
    if root.tag != "robot":
        raise UserError(f"this is no URDF: it begins with <{root.tag}>", "", file=path, line=root.line)
    for element in root.children:
        if element.tag.startswith("xacro:"):
            raise _unexpanded(path, element)
    reader = _Reader(path, root)
    links = {_text(link, "name", path): reader.link(link) for link in root.all("link")}
    if not links:
        raise UserError("the robot has no links", "add one", file=path, line=root.line)
    joints = tuple(reader.joint(joint, links) for joint in root.all("joint"))
    return UrdfFile(root.attributes.get("name", path.stem), links, joints)


def named_meshes(root: Element) -> list[str]:
    """The mesh files that a URDF names, as it spells them, each once."""
    found: dict[str, None] = {}

    def visit(element: Element) -> None:
        if element.tag == "mesh" and "filename" in element.attributes:
            found[element.attributes["filename"]] = None
        for child in element.children:
            visit(child)

    visit(root)
    return list(found)


def mesh_file(name: str, urdf: Path, line: int | None = None) -> Path:
    """Where a mesh is that a URDF names: beside it, or below one of the folders that it is in.

    Raises:
        UserError: If it is nowhere.
    """
    plain = name
    for scheme in _SCHEMES:
        plain = plain.removeprefix(scheme)
    folder = urdf.absolute().parent
    steps = Path(plain).parts
    for start in (folder, *folder.parents) if plain != name else (folder,):
        for skipped in (0, 1) if plain != name else (0,):
            found = start.joinpath(*steps[skipped:])
            if found.is_file():
                return found
    raise UserError(f"mesh '{name}' is not there", "put it beside the URDF", file=urdf, line=line)


@dataclass(frozen=True)
class _Reader:
    path: Path
    root: Element

    def link(self, element: Element) -> Link:
        visuals = [self._shape(shape) for shape in element.all("visual")]
        collisions = [self._shape(shape) for shape in element.all("collision")]
        inertial = element.first("inertial")
        mass = inertial.first("mass") if inertial else None
        greys = [self._grey(shape) for shape in element.all("visual")]
        return Link(
            mass=max(0.0, self._numbers(mass, "value", 1)[0]) if mass else 0.0,
            visuals=tuple(shape for shape in visuals if shape),
            collisions=tuple(shape for shape in collisions if shape),
            grey=round(float(np.mean(greys))) if greys else _GREY,
        )

    def joint(self, element: Element, links: dict[str, Link]) -> UrdfJoint:
        kind = _text(element, "type", self.path)
        if kind not in _KINDS:
            what, mend = f"there are no {kind} joints", f"choose among {', '.join(_KINDS)}"
            raise UserError(what, mend, file=self.path, line=element.line)
        ends = []
        for end in ("parent", "child"):
            tag = element.first(end)
            name = tag.attributes.get("link") if tag else None
            if name not in links:
                what = f"the joint's {end} '{name}' is no link"
                raise UserError(what, "name one of the links", file=self.path, line=(tag or element).line)
            ends.append(name)
        axis, limit = element.first("axis"), element.first("limit")
        direction = np.array(self._numbers(axis, "xyz", 3) if axis else (1.0, 0.0, 0.0))
        length = float(np.linalg.norm(direction))
        told = {
            key: self._numbers(limit, key, 1)[0] if limit and key in limit.attributes else 0.0
            for key in ("lower", "upper", "effort", "velocity")
        }
        return UrdfJoint(
            name=_text(element, "name", self.path),
            kind=kind,
            parent=ends[0],
            child=ends[1],
            pose=self._pose(element.first("origin")),
            axis=direction / length if length > 0 else np.array([1.0, 0.0, 0.0]),
            limits=(told["lower"], told["upper"]),
            effort=max(0.0, told["effort"]),
            velocity=max(0.0, told["velocity"]),
        )

    def _shape(self, element: Element) -> Geometry | None:
        geometry = element.first("geometry")
        if geometry is None or not geometry.children:
            return None
        shape, pose = geometry.children[0], self._pose(element.first("origin"))
        if shape.tag == "mesh":
            name = _text(shape, "filename", self.path)
            scale = self._numbers(shape, "scale", 3) if "scale" in shape.attributes else (1.0, 1.0, 1.0)
            return Geometry("mesh", scale, mesh_file(name, self.path, shape.line), pose)
        keys = {
            "box": ("size",),
            "sphere": ("radius",),
            "cylinder": ("radius", "length"),
            "capsule": ("radius", "length"),
        }
        if shape.tag not in keys:
            return None  # a plane, or something of another simulator's
        counts = {"size": 3}
        sizes = tuple(
            size for key in keys[shape.tag] for size in self._numbers(shape, key, counts.get(key, 1))
        )
        return Geometry(shape.tag, tuple(max(size, 1e-4) for size in sizes), None, pose)

    def _grey(self, visual: Element) -> int:
        material = visual.first("material")
        if material is None:
            return _GREY
        colour = material.first("color")
        if colour is None:
            name = material.attributes.get("name")
            known = (one for one in self.root.all("material") if one.attributes.get("name") == name)
            colour = next((one.first("color") for one in known), None)
        if colour is None:
            return _GREY
        rgb = np.clip(self._numbers(colour, "rgba", 4)[:3], 0, 1)
        return round(255 * float(rgb @ np.array(_LUMINANCE)))

    def _pose(self, origin: Element | None) -> Vector:
        if origin is None:
            return np.eye(4)
        place = self._numbers(origin, "xyz", 3) if "xyz" in origin.attributes else (0.0, 0.0, 0.0)
        turn = self._numbers(origin, "rpy", 3) if "rpy" in origin.attributes else (0.0, 0.0, 0.0)
        pose = translation(*place)
        pose[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
        return pose

    def _numbers(self, element: Element, key: str, count: int) -> tuple[float, ...]:
        told = element.attributes.get(key, "")
        try:
            numbers = tuple(float(number) for number in told.replace(",", " ").split())
        except ValueError:
            numbers = ()
        if len(numbers) == count and all(map(math.isfinite, numbers)):
            return numbers
        if "${" in told or "$(" in told:
            raise _unexpanded(self.path, element)
        what = f"'{key}' of <{element.tag}> must be {count} finite number{'s' * (count > 1)}"
        mend = f"write {count}" + (f", not '{told[:40]}'" if told else "")
        raise UserError(what, mend, file=self.path, line=element.line)


def _unexpanded(path: Path, element: Element) -> UserError:
    mend = "expand it with ROS's xacro, `xacro robot.xacro > robot.urdf`, and give that file"
    return UserError("this is xacro and not yet URDF", mend, file=path, line=element.line)


def _text(element: Element, key: str, path: Path) -> str:
    if not element.attributes.get(key):
        raise UserError(f"<{element.tag}> has no '{key}'", "give it one", file=path, line=element.line)
    return element.attributes[key]
