"""Embree, by embreex: triangles, of which the tree is built anew for each scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import Look, MissingError, Model, Rays, shades
from testbed.vision import CAPPED_CYLINDER, CUBOID, to_trimesh


def open_eye(rays: Rays, eye: float) -> Look:
    """Round shapes have the facets of a ball of 320 triangles.

    Raises:
        MissingError: If embreex is not installed.
    """
    try:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh
    except ImportError:
        raise MissingError("embreex is not installed (pip install -e '.[bench]')") from None
    starts = np.tile(np.array([eye, 0.0, 0.0], np.float32), (len(rays), 1))
    ways = np.column_stack([rays, np.ones(len(rays))]).astype(np.float32)
    box = _unit(np.array([CUBOID, 0, 0, 0, 0, 1, 1, 1.0]), 0)
    ball = _unit(np.array([CAPPED_CYLINDER, 0, 0, 0, 0, 1, 0.1, 0.0]), 1)
    side = np.sign(ball[..., :1])  # to which end of a capsule a corner belongs
    ball[..., :1] -= 0.05 * side

    def look(model: Model) -> NDArray[np.uint8]:
        scene, corners = rtcore_scene.EmbreeScene(), []
        for shape, x, y, z, omega, d1, d2, d3 in model:
            if shape == CUBOID:
                own = box * (d1, d3, d2)
            else:
                own = ball * d1
                if shape == CAPPED_CYLINDER:
                    own[..., :1] += side * (d2 / 2)
            c, s = np.cos(omega), np.sin(omega)
            corners.append(own @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + (x, y, z))
        TriangleMesh(scene, np.concatenate(corners).astype(np.float32))
        return shades(scene.run(starts, ways) >= 0)

    return look


def _unit(row: NDArray[np.float64], detail: int) -> NDArray[np.float64]:
    """Triangles (n, 3, 3) of a shape."""
    return np.array(to_trimesh(row, detail).triangles)
