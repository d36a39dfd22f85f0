"""What a robot's body is: a tree of simple parts, joined by hinges that a servo turns.

Section 3.1 of the paper describes one such body, three parts long. Here any number of parts hangs on a root; a
hinge turns its limb downward for positive angles and lies flat at zero. A body is a frozen description without
physics: it can be scaled, varied, measured, turned into a URDF or into meshes, and loaded from
``robots/<name>.yaml``.

Frames: every part's frame sits at its centre with x along its length and z up. A hinge's frame sits where the
limb is mounted, is turned by the mounting angle about the parent's z (0 points along the parent's x) and rotates
about its own y axis.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from testbed.bodies.joints import Joint, mount_of
from testbed.bodies.parts import CappedCylinder, Cuboid, Mesh, Part, Sphere, Vector
from testbed.documents import read_document, validate
from testbed.frames import rotation_y, rotation_z, translation
from testbed.frozen import Frozen
from testbed.resources import robot_path

__all__ = [
    "CappedCylinder",
    "Cuboid",
    "Joint",
    "Mesh",
    "Morphology",
    "Part",
    "Sphere",
    "Vector",
    "load_robot",
    "rotation_y",
    "rotation_z",
    "translation",
]


class Morphology(Frozen):
    """A body: named parts and the hinges that make a tree of them.

    The order of ``joints`` is the order of motor commands; the order of ``parts`` is the order of rolls.
    """

    name: str = Field(pattern=r"^[A-Za-z][\w-]*$")
    description: str = ""
    parts: dict[str, Part] = Field(min_length=1)
    joints: dict[str, Joint] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _is_a_tree(self) -> Self:
        carried: dict[str, str] = {}
        for name, joint in self.joints.items():
            for end in (joint.parent, joint.child):
                if end not in self.parts:
                    known = ", ".join(self.parts)
                    raise ValueError(f"joint '{name}' refers to no part: '{end}'; the parts are {known}")
            if joint.child in carried:
                raise ValueError(
                    f"part '{joint.child}' hangs on two joints, '{carried[joint.child]}' and '{name}'"
                )
            carried[joint.child] = name
        roots = [part for part in self.parts if part not in carried]
        if not roots:
            raise ValueError("the joints form a ring; one part must be carried by no joint")
        if len(roots) > 1:
            raise ValueError(f"the parts {', '.join(roots)} are not joined; add a joint between them")
        if len(self._reached(roots[0])) < len(self.parts):
            raise ValueError("some joints form a ring apart from the root; every part must lead back to it")
        return self

    def _reached(self, root: str) -> set[str]:
        reached, frontier = {root}, [root]
        while frontier:
            here = frontier.pop()
            for joint in self.joints.values():
                if joint.parent == here and joint.child not in reached:
                    reached.add(joint.child)
                    frontier.append(joint.child)
        return reached

    @property
    def root(self) -> str:
        """The part that no joint carries: the main body, where the tilt sensor sits."""
        carried = {joint.child for joint in self.joints.values()}
        return next(part for part in self.parts if part not in carried)

    @property
    def mass(self) -> float:
        """Total mass in kg."""
        return sum(part.mass for part in self.parts.values())

    @property
    def limits(self) -> Vector:
        """Joint limits, (joints, 2) in rad."""
        return np.array([joint.limits for joint in self.joints.values()]).reshape(-1, 2)

    @property
    def rest(self) -> Vector:
        """The angles (rad) of a body at rest, (joints,): flat, or as near to it as a joint's travel allows."""
        return np.clip(np.zeros(len(self.joints)), *self.limits.T)

    def scaled(self, factor: float) -> Morphology:
        """The same body, ``factor`` times as large, densities unchanged."""
        return self.model_copy(
            update={
                "parts": {name: part.scaled(factor) for name, part in self.parts.items()},
                "joints": {name: joint.scaled(factor) for name, joint in self.joints.items()},
            }
        )

    def stretched(self, factors: float | Sequence[float]) -> Morphology:
        """The same body with longer or shorter limbs.

        Args:
            factors: For all limbs, or for one after the other in the order of the joints; a limb without one keeps
                its length, a factor without a limb has no effect.
        """
        each = [factors] * len(self.joints) if isinstance(factors, int | float) else factors
        limbs = {
            joint.child: self.parts[joint.child].stretched(factor)
            for joint, factor in zip(self.joints.values(), each, strict=False)
        }
        return self.model_copy(update={"parts": {**self.parts, **limbs}})

    def varied(
        self,
        *,
        parts: Mapping[str, Mapping[str, object]] | None = None,
        joints: Mapping[str, Mapping[str, object]] | None = None,
    ) -> Morphology:
        """The same body with some fields of some parts and joints replaced, validated anew.

        Args:
            parts: Part name to the fields to replace, e.g. ``{"limb_a": {"length": 0.15}}``.
            joints: Joint name to the fields to replace, e.g. ``{"joint_b": {"angle_deg": 30}}``.

        Raises:
            KeyError: If a name is not in the body.
            pydantic.ValidationError: If the result is no valid body.
        """
        data = self.model_dump()
        for kind, changes in (("parts", parts or {}), ("joints", joints or {})):
            for name, fields in changes.items():
                data[kind][name] = {**data[kind][name], **fields}
        return Morphology.model_validate(data)

    def without(self, part: str) -> Morphology:
        """What is left of the body when a part falls off, with all that hangs on it.

        Raises:
            KeyError: If there is no such part, or it is the main body.
        """
        if part not in self.parts or part == self.root:
            raise KeyError(part)
        gone = self._reached(part)
        return self.model_copy(
            update={
                "parts": {name: kept for name, kept in self.parts.items() if name not in gone},
                "joints": {name: joint for name, joint in self.joints.items() if joint.child not in gone},
            }
        )

    def mount(self, joint: Joint) -> Vector:
        """Where a hinge sits in its parent's frame: a (4, 4) pose at joint angle zero."""
        return mount_of(self.parts[joint.parent], joint)

    def poses(self, angles: Sequence[float] | Vector) -> dict[str, Vector]:
        """Forward kinematics: each part's (4, 4) pose in the root's frame at these joint angles (rad)."""
        poses = {self.root: np.eye(4)}
        pending = list(zip(self.joints.values(), angles, strict=True))
        while pending:
            joint, angle = pending.pop(0)
            if joint.parent not in poses:
                pending.append((joint, angle))
                continue
            half_length = translation(self.parts[joint.child].from_hinge, 0, 0)
            poses[joint.child] = (
                poses[joint.parent] @ self.mount(joint) @ rotation_y(float(angle)) @ half_length
            )
        return {name: poses[name] for name in self.parts}

    def resting_height(self) -> float:
        """Height of the root's centre, in metres, when the body at rest touches the ground at its lowest point."""
        flat = self.poses(self.rest)
        return -min(float(pose[2, 3]) + self.parts[name].span(pose[2, :3])[0] for name, pose in flat.items())

    def reach(self) -> tuple[float, float, float]:
        """Smallest and greatest x of the flat body and the greatest height it can reach, in metres, from the root."""
        flat = self.poses(np.zeros(len(self.joints)))  # stretched out, whether or not its joints let it
        ends = [pose[0, 3] + end for name, pose in flat.items() for end in self.parts[name].span(pose[0, :3])]
        limbs = sum(part.length_along_x for name, part in self.parts.items() if name != self.root)
        if any(isinstance(part, Mesh) for part in self.parts.values()):
            limbs = self._longest_chain(self.root)
        return float(min(ends)), float(max(ends)), limbs + self.resting_height()

    def _longest_chain(self, part: str) -> float:
        """How far (m) from a part's frame it and all that hangs on it can reach, whichever way its hinges turn."""
        own = max(abs(end) for row in np.eye(3) for end in self.parts[part].span(row))
        hung = [joint for joint in self.joints.values() if joint.parent == part]
        places = [float(np.linalg.norm(self.mount(joint)[:3, 3])) for joint in hung]
        return (
            max(
                own,
                *(away + self._longest_chain(joint.child) for away, joint in zip(places, hung, strict=True)),
            )
            if hung
            else own
        )


def load_robot(name: str | Path) -> Morphology:
    """A robot from its description.

    Args:
        name: The name of a shipped robot (``crawler``), or the path of a YAML or URDF file.

    Raises:
        UserError: If there is no such robot, or its description is wrong.
    """
    path = Path(name) if Path(name).suffix else robot_path(str(name))
    if path.suffix.lower() in (".urdf", ".xacro"):
        from testbed.bodies.urdf_bodies import read_urdf  # made of bodies; meshes are slow to load

        return read_urdf(path.absolute())
    try:
        state = path.stat()
    except OSError:
        return validate(Morphology, read_document(path))  # says what is wrong
    return _read(path, state.st_mtime_ns, state.st_size)


@functools.lru_cache(maxsize=64)
def _read(path: Path, changed: int, size: int) -> Morphology:
    """The robot in a file; read anew when the file was changed, for scenarios name the same few over and over."""
    return validate(Morphology, read_document(path))
