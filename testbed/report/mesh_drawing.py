"""Parts that are meshes, as draughtsmen need them: triangles from the farthest to the nearest, each with its light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from testbed.bodies.morphology import Mesh, Vector
from testbed.bodies.urdf_bodies import link_shape

_FINEST = 6000
"""A mesh with more triangles is drawn by its convex pieces."""


def triangles_of(part: Mesh, pose: Vector, *, coarse: bool = False) -> tuple[Vector, Vector]:
    """The triangles (n, 3, 3) of a part in the world (m), and their normals (n, 3).

    Args:
        part: Which part.
        pose: (4, 4) of its frame.
        coarse: By its convex pieces.
    """
    shape = link_shape(Path(part.urdf), part.link)
    fine = not coarse and len(shape.seen.faces) <= _FINEST
    meshes = (shape.seen,) if fine else shape.hulls
    corners = np.concatenate([np.asarray(mesh.triangles, dtype=float) for mesh in meshes]) * part.factor
    placed = corners @ pose[:3, :3].T + pose[:3, 3]
    normals = np.cross(placed[:, 1] - placed[:, 0], placed[:, 2] - placed[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    real = lengths > 0
    return placed[real], normals[real] / lengths[real, None]


def seen_triangles(triangles: Vector, normals: Vector, toward: Vector) -> tuple[Vector, Vector]:
    """Those that face a viewer in direction ``toward`` (3,), the farthest first."""
    facing = normals @ toward > 0
    triangles, normals = triangles[facing], normals[facing]
    order = np.argsort(triangles.mean(axis=1) @ toward, kind="stable")
    return triangles[order], normals[order]


def draw_mesh(
    axes: Axes, part: Mesh, pose: Vector, basis: Vector, colour: str, order: float, alpha: float
) -> None:
    """Draw a part on paper; ``basis`` (3, 3) are the directions to the right, up and towards the viewer."""
    triangles, normals = seen_triangles(*triangles_of(part, pose), basis[2])
    light = 0.34 * normals[:, 2] + 0.10 * normals[:, 0] - 0.06
    share = np.minimum(np.abs(light), 0.4)[:, None]
    colours = np.array(to_rgb(colour)) * (1 - share) + np.where(light[:, None] > 0, 1.0, 0.0) * share
    faces = PolyCollection(
        list(triangles @ basis[:2].T),
        facecolors=colours,
        edgecolors=colours,
        linewidths=0.2,
        alpha=alpha,
        zorder=order,
        rasterized=True,  # thousands of triangles would make a drawing too large
    )
    axes.add_collection(faces)
