"""The simple parts that bodies are made of: cuboids, balls and capped cylinders, frozen descriptions in metres."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from testbed.frozen import Frozen

Vector = NDArray[np.float64]
Length = Annotated[float, Field(gt=0, le=2.0, description="metres")]


class _Part(Frozen):
    density: float = Field(600.0, gt=0, le=30_000, description="kg/m3; the paper's 0.6 g/cm3")
    friction: float = Field(0.5, ge=0, le=5, description="Coulomb coefficient against a ground of 1")
    luminosity: int = Field(110, ge=0, le=255, description="grey level under full light")

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

    def scaled(self, factor: float) -> Self:
        """The same part, ``factor`` times as large."""
        return self.model_copy(update={"radius": self.radius * factor, "length": self.length * factor})

    def stretched(self, factor: float) -> Self:
        """The same part, ``factor`` times as long between its caps."""
        return self.model_copy(update={"length": self.length * factor})


Part = Annotated[Cuboid | Sphere | CappedCylinder, Field(discriminator="shape")]
