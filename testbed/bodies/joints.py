"""The hinges of bodies: frozen descriptions, and where they sit."""

from __future__ import annotations

import math
from typing import Self

from pydantic import Field, model_validator

from testbed.bodies.parts import CappedCylinder, Mesh, Part, Sphere, Vector
from testbed.frames import rotation_about, rotation_z, translation
from testbed.frozen import Frozen


class Joint(Frozen):
    """A hinge with a servo between a parent and a child part."""

    parent: str
    child: str
    angle_deg: float = Field(0.0, ge=-360, le=360, description="mounting angle about the parent's z axis")
    along: float = Field(1.0, ge=0, le=1, description="place on a capped cylinder: 0 near end, 1 far end")
    height: float = Field(0.0, ge=-1, le=1, description="metres above the parent's centre")
    across: float = Field(
        0.0, ge=-1, le=1, description="metres to the left of there, looking the way it is mounted"
    )
    frame: tuple[float, float, float, float, float, float] | None = Field(
        None,
        description="instead of the four above: place (m) and rotation vector (rad) in the parent's frame",
    )
    limits_deg: tuple[float, float] = Field((-90.0, 90.0), description="travel; the paper's [-90, 90]")
    torque: float = Field(1.2, gt=0, le=1000, description="N m; a standard hobby servo of 12 kg cm")
    speed_deg: float = Field(
        300.0, gt=0, le=3600, description="deg/s; a standard hobby servo: 60 deg in 0.2 s"
    )

    @model_validator(mode="after")
    def _ordered_limits(self) -> Self:
        low, high = self.limits_deg
        if not -180 <= low < high <= 180:
            raise ValueError(
                f"limits_deg must be two rising angles within [-180, 180], not [{low:g}, {high:g}]"
            )
        return self

    @property
    def limits(self) -> tuple[float, float]:
        """Travel in rad."""
        low, high = self.limits_deg
        return math.radians(low), math.radians(high)

    def scaled(self, factor: float) -> Self:
        """The same hinge on a body ``factor`` times as large; torque grows as weight times length does."""
        update: dict[str, object] = {"height": self.height * factor, "torque": self.torque * factor**4}
        if self.across:
            update["across"] = self.across * factor
        if self.frame is not None:
            update["frame"] = (*(length * factor for length in self.frame[:3]), *self.frame[3:])
        return self.model_copy(update=update)


def mount_of(parent: Part, joint: Joint) -> Vector:
    """Where a hinge sits in its parent's frame: a (4, 4) pose at joint angle zero."""
    if joint.frame is not None:
        return translation(*joint.frame[:3]) @ rotation_about(joint.frame[3:])
    angle = math.radians(joint.angle_deg)
    c, s = math.cos(angle), math.sin(angle)
    if isinstance(parent, CappedCylinder):
        place = (parent.length * (joint.along - 0.5), 0.0, joint.height)
    elif isinstance(parent, Sphere):
        place = (parent.radius * c, parent.radius * s, joint.height)
    elif isinstance(parent, Mesh):
        place = (0.0, 0.0, joint.height)
    else:  # where a ray from the centre leaves the rectangle seen from above
        half_x, half_y = parent.size[0] / 2, parent.size[1] / 2
        distance = min(half_x / max(abs(c), 1e-12), half_y / max(abs(s), 1e-12))
        place = (distance * c, distance * s, joint.height)
    pose = translation(*place) @ rotation_z(angle)
    return pose @ translation(0, joint.across, 0) if joint.across else pose
