"""A body as URDF, the format that simulators read."""

from __future__ import annotations

import math
from xml.etree import ElementTree as xml

from testbed.morphology import CappedCylinder, Cuboid, Joint, Morphology, Sphere


def to_urdf(body: Morphology) -> str:
    """The body as URDF text.

    Links carry their part's name, joints their joint's name. Each link's frame sits in the hinge that carries it
    (the root's in its own centre); masses and inertias are exact; contact coefficients are in PyBullet's
    ``<contact>`` element.
    """
    robot = xml.Element("robot", name=body.name)
    for name, part in body.parts.items():
        offset = 0.0 if name == body.root else part.length_along_x / 2
        robot.append(_link(name, part, offset))
    for name, joint in body.joints.items():
        robot.append(_joint(name, joint, body))
    xml.indent(robot)
    return xml.tostring(robot, encoding="unicode") + "\n"


def _link(name: str, part: Cuboid | Sphere | CappedCylinder, offset: float) -> xml.Element:
    link = xml.Element("link", name=name)
    contact = xml.SubElement(link, "contact")
    xml.SubElement(contact, "lateral_friction", value=f"{part.friction:.9g}")
    inertial = xml.SubElement(link, "inertial")
    xml.SubElement(inertial, "origin", xyz=f"{offset:.9g} 0 0")
    xml.SubElement(inertial, "mass", value=f"{part.mass:.9g}")
    along, across, up = part.inertia
    moments = {"ixx": along, "iyy": across, "izz": up, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    xml.SubElement(inertial, "inertia", {key: f"{moment:.9g}" for key, moment in moments.items()})
    grey = f"{part.luminosity / 255:.4g}"
    for purpose in ("visual", "collision"):
        element = xml.SubElement(link, purpose)
        # URDF's capsule lies along z, ours along x.
        pitch = math.pi / 2 if isinstance(part, CappedCylinder) else 0.0
        xml.SubElement(element, "origin", xyz=f"{offset:.9g} 0 0", rpy=f"0 {pitch:.17g} 0")
        element.append(_geometry(part))
        if purpose == "visual":
            material = xml.SubElement(element, "material", name=f"{name}_grey")
            xml.SubElement(material, "color", rgba=f"{grey} {grey} {grey} 1")
    return link


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
    x, y, z = body.mount(joint)[:3, 3]
    if joint.parent != body.root:  # a link's frame is in its hinge, not in its centre
        x += body.parts[joint.parent].length_along_x / 2
    xml.SubElement(
        element, "origin", xyz=f"{x:.9g} {y:.9g} {z:.9g}", rpy=f"0 0 {math.radians(joint.angle_deg):.17g}"
    )
    xml.SubElement(element, "axis", xyz="0 1 0")
    low, high = joint.limits
    speed = math.radians(joint.speed_deg)
    limit = {"lower": low, "upper": high, "effort": joint.torque, "velocity": speed}
    xml.SubElement(element, "limit", {key: f"{value:.9g}" for key, value in limit.items()})
    return element
