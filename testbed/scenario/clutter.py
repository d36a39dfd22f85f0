"""Things that stand around and are no robots: candidates at first sight, or what lies behind a teacher."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from testbed.bodies.parts import CappedCylinder, Cuboid, Part, Sphere, Texture
from testbed.document_errors import mistake
from testbed.scenario.base import Spec, unit_field

MOST_CLUTTER = 32
Size = Annotated[float, Field(ge=0.005, le=2, json_schema_extra={"unit": "m"})]


class ClutterSpec(Spec):
    """A thing that stands on the ground where the rig sees it, and does not move.

    ``box``: length, width and height; ``ball``: diameter; ``post``, a capped cylinder upright: width and height.
    """

    shape: Literal["box", "ball", "post"] = "box"
    size: tuple[Size, ...] = Field((0.1, 0.1, 0.1), description="in metres")
    distance: float = unit_field(1.2, "m", ge=0.2, le=15)
    bearing_deg: float = Field(0.0, ge=-180, le=180)
    facing_deg: float = Field(0.0, ge=-360, le=360)
    height: float = unit_field(0.0, "m", ge=0, le=2, description="above the ground")
    luminosity: float = unit_field(110.0, "grey levels", ge=0, le=255)
    texture: Texture | None = None

    @model_validator(mode="after")
    def _is_a_thing(self) -> Self:
        needed = {"box": 3, "ball": 1, "post": 2}[self.shape]
        if len(self.size) != needed:
            what = f"the size of a {self.shape} has {len(self.size)} numbers"
            raise mistake(what, f"give {needed}, in metres", at="size")
        if self.shape == "post" and self.size[1] <= self.size[0]:
            raise mistake("a post is no higher than wide", "use shape: ball, or make it higher", at="size")
        return self

    @property
    def part(self) -> Part:
        """Its body; a post's lies along x."""
        looks = {"luminosity": round(self.luminosity), "texture": self.texture}
        if self.shape == "box":
            length, width, height = self.size
            return Cuboid(size=(length, width, height), **looks)
        if self.shape == "ball":
            return Sphere(radius=self.size[0] / 2, **looks)
        width, height = self.size
        return CappedCylinder(radius=width / 2, length=height - width, **looks)
