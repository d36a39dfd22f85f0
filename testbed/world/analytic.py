"""The rig's pictures by exact ray casting instead of Bullet's renderer: the same bodies, many times as fast.

Chosen by ``rig: {renderer: analytic}``. What is the same: where everybody is, who hides whom, the light and its three
shares, the background, and all that the sensor does afterwards. What differs from TinyRenderer:

- balls and capped cylinders are round and shaded as such; TinyRenderer draws few flat facets, shrinks the caps, and
  shades a capped cylinder by the direction from its middle, so that one half is dark and the other bright;
- a pixel looks through its own centre; TinyRenderer's picture lies half a rendered pixel to the right and above;
- the sensor's noise has the same distribution, drawn more quickly, and so other values for the same seed;
- meshes and textures cannot be drawn, and are refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import CappedCylinder, Cuboid, Morphology, Sphere, Vector
from testbed.errors import UserError
from testbed.physics import Simulation
from testbed.scenario.specs import RigSpec
from testbed.vision import CAPPED_CYLINDER, CUBOID, SPHERE
from testbed.vision.shading import cast


class AnalyticRenderer:
    """Takes the pictures of a rig in a simulation.

    Args:
        simulation: Whose bodies are drawn, as they are when a picture is taken.
        rig: Its cameras, the light and the background.
        shape: Rows and columns of the sensor; a picture has ``rig.supersample`` times as many.

    Raises:
        UserError: Here and when a picture is taken, if a body cannot be drawn.
    """

    def __init__(self, simulation: Simulation, rig: RigSpec, shape: tuple[int, int]) -> None:
        self._simulation = simulation
        self._background = rig.background
        rows, columns = shape[0] * rig.supersample, shape[1] * rig.supersample
        self._depth = np.full((rows, columns), np.inf, np.float32)
        self._picture = np.full((rows, columns), self._background, np.float32)
        self._drawn = slice(0), slice(0)
        across = math.tan(math.radians(rig.field_of_view_deg) / 2)
        self._lens = np.array([across, across * shape[0] / shape[1]])
        light = rig.light
        self._light = np.array(light.direction) / math.hypot(*light.direction)
        self._shares = np.array([light.ambient, light.diffuse, light.specular])
        self._bodies: tuple[Morphology, ...] = ()
        self._solids = np.zeros((0, 5))
        self._scene()

    def pictures(self, eyes: Vector, pan: float) -> Iterator[NDArray[np.float32]]:
        """Luminosities (rows, columns) seen from eyes (m, 3) in direction ``pan`` (rad, positive to the right).

        One after the other, all in the same memory: look at one before you ask for the next.
        """
        sine, cosine = math.sin(pan), math.cos(pan)
        turned = np.array([[cosine, -sine, 0.0], [0.0, 0.0, 1.0], [sine, cosine, 0.0]])
        solids, poses = self._scene()
        for eye in eyes:
            self._depth[self._drawn] = np.inf
            self._picture[self._drawn] = self._background
            top, bottom, begin, end = cast(
                solids,
                poses,
                turned,
                eye,
                self._lens,
                self._light,
                self._shares,
                self._depth,
                self._picture,
            )
            self._drawn = slice(top, bottom), slice(begin, end)
            yield self._picture

    def _scene(self) -> tuple[Vector, Vector]:
        """What all bodies are made of, and where that is now, as :func:`testbed.vision.shading.cast` takes it."""
        bodies = self._simulation.bodies
        if self._bodies != (now := tuple(bodies.values())):
            self._bodies, self._solids = now, np.concatenate([np.zeros((0, 5)), *map(solids_of, now)])
        return self._solids, np.concatenate([np.zeros((0, 7)), *map(self._simulation.frames, bodies)])


def solids_of(body: Morphology) -> Vector:
    """(parts, 5) a body as :func:`testbed.vision.shading.cast` takes it.

    Raises:
        UserError: If it cannot be drawn.
    """
    refusal = undrawable(body)
    if refusal is not None:
        raise refusal
    solids = np.zeros((len(body.parts), 5))
    for row, part in zip(solids, body.parts.values(), strict=True):
        if isinstance(part, Cuboid):
            row[:4] = CUBOID, *part.size
        elif isinstance(part, Sphere):
            row[:2] = SPHERE, part.radius
        elif isinstance(part, CappedCylinder):
            row[:3] = CAPPED_CYLINDER, part.radius, part.length
        row[4] = part.luminosity
    return solids


def undrawable(body: Morphology) -> UserError | None:
    """Why the analytic renderer cannot draw a body, if it cannot: only plain cuboids, balls and capped cylinders."""
    for name, part in body.parts.items():
        plain = isinstance(part, Cuboid | Sphere | CappedCylinder)
        if not plain or part.texture is not None:
            what = "which has a texture" if plain else f"a {part.shape}"
            return UserError(
                f"the analytic renderer cannot draw part '{name}' of robot '{body.name}', {what}",
                "write 'rig: {renderer: tinyrenderer}'",
            )
    return None
