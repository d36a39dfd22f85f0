"""The parts that bodies are made of: cuboids, balls and capped cylinders, frozen descriptions in metres.

Bodies that come from elsewhere as URDF are made of meshes.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from testbed.errors import UserError
from testbed.frozen import Frozen

Vector = NDArray[np.float64]
Length = Annotated[float, Field(gt=0, le=2.0, description="metres")]


class Texture(Frozen):
    """A pattern on a part's surface: brighter and darker than its grey level by a share of it."""

    pattern: Literal["stripes", "checks", "speckles"] = "checks"
    contrast: float = Field(0.4, ge=0, le=1, description="0.4: from 60% to 140% of the grey level")
    patches: int = Field(6, ge=1, le=32, description="how many lie along a face")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="which speckles")


class _Part(Frozen):
    density: float = Field(600.0, gt=0, le=30_000, description="kg/m3; the paper's 0.6 g/cm3")
    friction: float = Field(0.5, ge=0, le=5, description="Coulomb coefficient against a ground of 1")
    luminosity: int = Field(110, ge=0, le=255, description="grey level under full light")
    texture: Texture | None = None

    @property
    def volume(self) -> float:
        """Volume in cubic metres."""
        raise NotImplementedError

    @property
    def mass(self) -> float:
        """Mass in kilograms."""
        return self.density * self.volume

    @property
    def length_along_x(self) -> float:
        """Distance from the hinge that carries this part to the hinges at its far end, in metres."""
        raise NotImplementedError

    @property
    def from_hinge(self) -> float:
        """How far (m, along x) the part's frame is from the hinge that carries it."""
        return self.length_along_x / 2

    def span(self, row: Vector) -> tuple[float, float]:
        """From where to where (m) it reaches along an axis that is ``row`` (3,) in its frame, from its origin."""
        raise NotImplementedError

    def stretched(self, factor: float) -> Self:
        """The same part, ``factor`` times as long."""
        raise NotImplementedError


class Cuboid(_Part):
    """A rectangular solid."""

    shape: Literal["cuboid"] = "cuboid"
    size: tuple[Length, Length, Length] = Field(description="length, width, height in metres")

    @property
    def volume(self) -> float:
        """Volume in cubic metres."""
        return math.prod(self.size)

    @property
    def inertia(self) -> Vector:
        """Principal moments of inertia about the centre, (3,) in kg m2."""
        x, y, z = (side**2 for side in self.size)
        return self.mass / 12 * np.array([y + z, x + z, x + y])

    @property
    def length_along_x(self) -> float:
        """The length."""
        return self.size[0]

    def span(self, row: Vector) -> tuple[float, float]:
        """See :meth:`_Part.span`."""
        half = float(np.abs(row) @ np.array(self.size) / 2)
        return -half, half

    def scaled(self, factor: float) -> Self:
        """The same part, ``factor`` times as large."""
        x, y, z = self.size
        return self.model_copy(update={"size": (x * factor, y * factor, z * factor)})

    def stretched(self, factor: float) -> Self:
        """The same part, ``factor`` times as long."""
        x, y, z = self.size
        return self.model_copy(update={"size": (x * factor, y, z)})


class Sphere(_Part):
    """A ball."""

    shape: Literal["sphere"] = "sphere"
    radius: Length

    @property
    def volume(self) -> float:
        """Volume in cubic metres."""
        return 4 / 3 * math.pi * self.radius**3

    @property
    def inertia(self) -> Vector:
        """Principal moments of inertia about the centre, (3,) in kg m2."""
        return np.full(3, 0.4 * self.mass * self.radius**2)

    @property
    def length_along_x(self) -> float:
        """The diameter."""
        return 2 * self.radius

    def span(self, row: Vector) -> tuple[float, float]:
        """See :meth:`_Part.span`."""
        return -self.radius, self.radius

    def scaled(self, factor: float) -> Self:
        """The same part, ``factor`` times as large."""
        return self.model_copy(update={"radius": self.radius * factor})

    def stretched(self, factor: float) -> Self:
        """The same ball, ``factor`` times as large: it stays a ball."""
        return self.scaled(factor)


class CappedCylinder(_Part):
    """A cylinder along x with a half ball on each end; ``length`` is the cylinder's alone."""

    shape: Literal["capped_cylinder"] = "capped_cylinder"
    radius: Length
    length: Length

    @property
    def volume(self) -> float:
        """Volume in cubic metres, caps included."""
        return math.pi * self.radius**2 * (self.length + 4 / 3 * self.radius)

    @property
    def inertia(self) -> Vector:
        """Principal moments of inertia about the centre, (3,) in kg m2."""
        r, h = self.radius, self.length
        cylinder = self.density * math.pi * r**2 * h
        caps = self.density * 4 / 3 * math.pi * r**3
        along = cylinder * r**2 / 2 + caps * 0.4 * r**2
        across = cylinder * (h**2 / 12 + r**2 / 4) + caps * (0.4 * r**2 + h**2 / 4 + 3 / 8 * h * r)
        return np.array([along, across, across])

    @property
    def length_along_x(self) -> float:
        """The cylinder's length: hinges sit in the centres of the caps."""
        return self.length

    def span(self, row: Vector) -> tuple[float, float]:
        """See :meth:`_Part.span`."""
        half = self.radius + abs(float(row[0])) * self.length / 2
        return -half, half

    def scaled(self, factor: float) -> Self:
        """The same part, ``factor`` times as large."""
        return self.model_copy(update={"radius": self.radius * factor, "length": self.length * factor})

    def stretched(self, factor: float) -> Self:
        """The same part, ``factor`` times as long between its caps."""
        return self.model_copy(update={"length": self.length * factor})


Triple = tuple[float, float, float]


class Mesh(_Part):
    """A part of a URDF's robot; its frame sits in its hinge, or in its centre of mass if it is the root.

    All but ``factor`` is told of the robot as large as its file makes it.
    """

    shape: Literal["mesh"] = "mesh"
    urdf: str = Field(description="the file")
    link: str = Field(description="the first of the links that it is made of")
    factor: float = Field(1.0, gt=0, description="how many times as large it is")
    solid: float = Field(gt=0, description="volume of its convex pieces, m3")
    centre: Triple = Field(description="of mass, in its frame, m")
    moments: Triple = Field(description="of inertia about axes along its frame's, at a density of 1, m5")
    box: tuple[Triple, Triple] = Field(description="lowest and highest corner around it in its frame, m")

    @property
    def volume(self) -> float:
        """Volume in cubic metres."""
        return self.solid * self.factor**3

    @property
    def inertia(self) -> Vector:
        """Moments of inertia about the centre of mass, (3,) in kg m2."""
        return np.array(self.moments) * self.density * self.factor**5

    @property
    def length_along_x(self) -> float:
        """The length of the box around it."""
        return self.size[0]

    @property
    def size(self) -> Triple:
        """Length, width and height of the box around it, m."""
        x, y, z = (high - low for low, high in zip(*self.box, strict=True))
        return x * self.factor, y * self.factor, z * self.factor

    @property
    def radius(self) -> float:
        """Half the longest side of that box, m: to those who know balls and capped cylinders alone."""
        return max(self.size) / 2

    @property
    def length(self) -> float:
        """Nothing, to the same."""
        return 0.0

    @property
    def from_hinge(self) -> float:
        """Nothing: its frame is in its hinge."""
        return 0.0

    @property
    def points(self) -> Vector:
        """(n, 3) the corners of its convex hull, m."""
        from testbed.bodies.urdf_bodies import link_shape  # meshes are slow to load

        return link_shape(Path(self.urdf), self.link).points * self.factor

    def span(self, row: Vector) -> tuple[float, float]:
        """See :meth:`_Part.span`."""
        along = self.points @ row
        return float(along.min()), float(along.max())

    def scaled(self, factor: float) -> Self:
        """The same part, ``factor`` times as large."""
        return self.model_copy(update={"factor": self.factor * factor})

    def stretched(self, factor: float) -> Self:
        """A mesh cannot be stretched.

        Raises:
            UserError: Always.
        """
        raise UserError("a limb that is a mesh cannot be made longer", "leave limb_scale out, or use scale")


Part = Annotated[Cuboid | Sphere | CappedCylinder | Mesh, Field(discriminator="shape")]
