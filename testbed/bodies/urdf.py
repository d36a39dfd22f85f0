"""A body as URDF, the format that simulators read."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np

from testbed.bodies.morphology import CappedCylinder, Cuboid, Joint, Mesh, Morphology, Part, Sphere, Vector


def write_urdf(body: Morphology, folder: Path) -> Path:
    """Write the body into a folder as ``body.urdf``, with its meshes beside it."""
    for number, part in enumerate(body.parts.values()):
        if isinstance(part, Mesh):
            from testbed.bodies.urdf_bodies import link_shape  # meshes are slow to load

            shape = link_shape(Path(part.urdf), part.link)
            for name, mesh in zip(
                _mesh_files(number, len(shape.hulls)), (shape.seen, *shape.hulls), strict=True
            ):
                corners = np.asarray(mesh.triangles, dtype=float) * part.factor
                (folder / name).write_text(_obj(corners))
    file = folder / "body.urdf"
    file.write_text(to_urdf(body))
    return file


def _mesh_files(number: int, hulls: int) -> list[str]:
    return [f"part_{number}.obj", *(f"part_{number}_{hull}.obj" for hull in range(hulls))]


def _obj(triangles: Vector) -> str:
    """Triangles (n, 3, 3) as an OBJ file: each with its own normal, patterns laid on along x and z."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    triangles, normals = triangles[lengths > 0], normals[lengths > 0] / lengths[lengths > 0, None]
    corners = triangles.reshape(-1, 3)
    low, size = corners.min(axis=0), np.maximum(np.ptp(corners, axis=0), 1e-9)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in corners.tolist()]
    lines += [f"vt {u:.4g} {v:.4g}" for u, _, v in ((corners - low) / size).tolist()]
    lines += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in normals.tolist()]
    for face in range(len(triangles)):
        a, b, c, n = 3 * face + 1, 3 * face + 2, 3 * face + 3, face + 1
        lines.append(f"f {a}/{a}/{n} {b}/{b}/{n} {c}/{c}/{n}")
    return "\n".join(lines) + "\n"


def to_urdf(body: Morphology) -> str:
    """The body as URDF text.

    Links carry their part's name, joints their joint's name. Each link's frame sits in the hinge that carries it
    (the root's in its own centre); masses and inertias are exact; contact coefficients are in PyBullet's
    ``<contact>`` element.
    """
    robot = xml.Element("robot", name=body.name)
    for number, (name, part) in enumerate(body.parts.items()):
        if isinstance(part, Mesh):
            robot.append(_mesh_link(name, part, number))
            continue
        offset = 0.0 if name == body.root else part.from_hinge
        robot.append(_link(name, part, offset))
    for name, joint in body.joints.items():
        robot.append(_joint(name, joint, body))
    xml.indent(robot)
    return xml.tostring(robot, encoding="unicode") + "\n"


def _link(name: str, part: Cuboid | Sphere | CappedCylinder, offset: float) -> xml.Element:
    link = _heavy_link(name, part, (offset, 0.0, 0.0))
    for purpose in ("visual", "collision"):
        element = xml.SubElement(link, purpose)
        # URDF's capsule lies along z, ours along x.
        pitch = math.pi / 2 if isinstance(part, CappedCylinder) else 0.0
        xml.SubElement(element, "origin", xyz=f"{offset:.9g} 0 0", rpy=f"0 {pitch:.17g} 0")
        element.append(_geometry(part))
        if purpose == "visual":
            _paint(element, name, part)
    return link


def _mesh_link(name: str, part: Mesh, number: int) -> xml.Element:
    from testbed.bodies.urdf_bodies import link_shape  # meshes are slow to load

    x, y, z = (length * part.factor for length in part.centre)
    link = _heavy_link(name, part, (x, y, z))
    hulls = len(link_shape(Path(part.urdf), part.link).hulls)
    for index, file in enumerate(_mesh_files(number, hulls)):
        element = xml.SubElement(link, "visual" if index == 0 else "collision")
        xml.SubElement(xml.SubElement(element, "geometry"), "mesh", filename=file)
        if index == 0:
            _paint(element, name, part)
    return link


def _heavy_link(name: str, part: Part, centre: tuple[float, float, float]) -> xml.Element:
    """A link without a shape: its friction, its mass, and its centre of mass in its frame (m)."""
    x, y, z = centre
    link = xml.Element("link", name=name)
    contact = xml.SubElement(link, "contact")
    xml.SubElement(contact, "lateral_friction", value=f"{part.friction:.9g}")
    inertial = xml.SubElement(link, "inertial")
    xml.SubElement(inertial, "origin", xyz=f"{x:.9g} {y:.9g} {z:.9g}")
    xml.SubElement(inertial, "mass", value=f"{part.mass:.9g}")
    along, across, up = part.inertia
    moments = {"ixx": along, "iyy": across, "izz": up, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    xml.SubElement(inertial, "inertia", {key: f"{moment:.9g}" for key, moment in moments.items()})
    return link


def _paint(visual: xml.Element, name: str, part: Part) -> None:
    grey = f"{part.luminosity / 255:.4g}"
    material = xml.SubElement(visual, "material", name=f"{name}_grey")
    xml.SubElement(material, "color", rgba=f"{grey} {grey} {grey} 1")


def _geometry(part: Cuboid | Sphere | CappedCylinder) -> xml.Element:
    geometry = xml.Element("geometry")
    if isinstance(part, Cuboid):
        xml.SubElement(geometry, "box", size=" ".join(f"{side:.9g}" for side in part.size))
    elif isinstance(part, Sphere):
        xml.SubElement(geometry, "sphere", radius=f"{part.radius:.9g}")
    else:
        xml.SubElement(geometry, "capsule", radius=f"{part.radius:.9g}", length=f"{part.length:.9g}")
    return geometry


def _joint(name: str, joint: Joint, body: Morphology) -> xml.Element:
    element = xml.Element("joint", name=name, type="revolute")
    xml.SubElement(element, "parent", link=joint.parent)
    xml.SubElement(element, "child", link=joint.child)
    mount = body.mount(joint)
    x, y, z = mount[:3, 3]
    if joint.parent != body.root:  # a link's frame is in its hinge, not in its centre
        x += body.parts[joint.parent].from_hinge
    rpy = f"0 0 {math.radians(joint.angle_deg):.17g}"
    if joint.frame is not None:
        rpy = " ".join(f"{angle:.17g}" for angle in _roll_pitch_yaw(mount))
    xml.SubElement(element, "origin", xyz=f"{x:.9g} {y:.9g} {z:.9g}", rpy=rpy)
    xml.SubElement(element, "axis", xyz="0 1 0")
    low, high = joint.limits
    speed = math.radians(joint.speed_deg)
    limit = {"lower": low, "upper": high, "effort": joint.torque, "velocity": speed}
    xml.SubElement(element, "limit", {key: f"{value:.9g}" for key, value in limit.items()})
    return element


def _roll_pitch_yaw(pose: Vector) -> tuple[float, float, float]:
    """The turns about fixed x, y and z, one after the other, that make a pose's orientation, rad."""
    level = math.hypot(pose[0, 0], pose[1, 0])
    pitch = math.atan2(-pose[2, 0], level)
    if level < 1e-9:  # straight up or down: what would be yaw is roll
        return math.atan2(-pose[1, 2], pose[1, 1]), pitch, 0.0
    return math.atan2(pose[2, 1], pose[2, 2]), pitch, math.atan2(pose[1, 0], pose[0, 0])
