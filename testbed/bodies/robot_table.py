"""A robot in tables: its parts and its joints."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from testbed.bodies.morphology import Cuboid, Mesh, Morphology, Part, Sphere

_CM = 100.0
_GRAMS = 1000.0


def part_table(body: Morphology) -> Table:
    """Parts with their sizes and masses, and the whole mass."""
    table = Table(
        title=f"{body.name}: {len(body.parts)} parts, {body.mass * _GRAMS:.0f} g", title_justify="left"
    )
    table.add_column("part")
    table.add_column("shape")
    table.add_column("size")
    table.add_column("mass", justify="right")
    for name, part in body.parts.items():
        root = " (root)" if name == body.root else ""
        table.add_row(name + root, part.shape.replace("_", " "), _size(part), f"{part.mass * _GRAMS:.0f} g")
    return table


def joint_table(body: Morphology) -> Table:
    """Joints with what they join and how they turn."""
    table = Table()
    for heading in ("joint", "parent", "child", "mounted at", "travel", "torque"):
        table.add_column(heading)
    for name, joint in body.joints.items():
        low, high = joint.limits_deg
        mounted = f"{joint.angle_deg:g} deg" if joint.frame is None else "its own frame"
        travel, torque = f"{low:g} to {high:g} deg", f"{joint.torque:.3g} N m"
        table.add_row(name, joint.parent, joint.child, mounted, travel, torque)
    return table


def plain_facts(body: Morphology) -> dict[str, Any]:
    """The same as plain data: masses in kg, the description's own units elsewhere."""
    return {
        "robot": body.name,
        "mass": body.mass,
        "root": body.root,
        "parts": {name: {**part.model_dump(), "mass": part.mass} for name, part in body.parts.items()},
        "joints": {name: joint.model_dump() for name, joint in body.joints.items()},
    }


def _size(part: Part) -> str:
    if isinstance(part, Cuboid):
        return " x ".join(f"{side * _CM:g}" for side in part.size) + " cm"
    if isinstance(part, Sphere):
        return f"r {part.radius * _CM:g} cm"
    if isinstance(part, Mesh):
        return " x ".join(f"{side * _CM:.3g}" for side in part.size) + " cm"
    return f"r {part.radius * _CM:g} cm, h {part.length * _CM:g} cm"
