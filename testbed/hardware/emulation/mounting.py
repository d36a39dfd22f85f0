"""How a tilt sensor is glued to its robot, and what it feels there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.frames import rotation_about

_ASKEW_DEG = 4.0
_BIAS = 0.03
_SCALE_OFF = 0.01


@dataclass(frozen=True)
class Mounting:
    """The way from what a body's root feels to what its sensor says.

    Attributes:
        rotation: (3, 3) from the root's axes to the sensor's.
        scale: (3,) gain of each axis.
        bias: (3,) what each axis adds, g.
    """

    rotation: Vector
    scale: Vector
    bias: Vector

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Self:
        """A sensor as glued by hand, some degrees askew, with the errors of its data sheet."""
        askew = rng.normal(0.0, math.radians(_ASKEW_DEG) / math.sqrt(3), 3)
        return cls(
            rotation=rotation_about(askew.tolist())[:3, :3],
            scale=1 + rng.uniform(-_SCALE_OFF, _SCALE_OFF, 3),
            bias=rng.uniform(-_BIAS, _BIAS, 3),
        )

    def says(self, felt: Vector) -> Vector:
        """(3,) g, as the sensor says it, of the specific force (3,) in g in the root's axes."""
        return np.asarray(self.scale * (self.rotation @ felt) + self.bias)


def felt(quaternion: Vector, acceleration: Vector, gravity: float) -> Vector:
    """(3,) the specific force on a body in its own axes, in units of standard gravity: 1 upward at rest.

    Args:
        quaternion: (4,) its orientation, xyzw.
        acceleration: (3,) of its centre, world, m/s2.
        gravity: Downward, m/s2.
    """
    x, y, z, w = (float(part) for part in quaternion)
    turned = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.asarray(turned.T @ (acceleration + np.array([0.0, 0.0, gravity])) / 9.80665)
