"""The three shapes that a teacher model is made of (Section 3.3.2, Eq. 2).

A model is an array (k, 8), one row a part: shape, x, y, z, omega, d1, d2, d3 in the rig frame (m, rad).
All sizes are full lengths except radii:

- cuboid: d1 length along its own x, d2 width along depth, d3 height along its own y;
- sphere: d1 radius;
- capped cylinder: d1 radius, d2 length without the caps, axis along its own x.

The own x axis points to (cos omega, sin omega, 0): y is down, so omega > 0 turns clockwise in the image.
Pitch and yaw are kept at zero, as in the paper.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import trimesh

CUBOID, SPHERE, CAPPED_CYLINDER = 0, 1, 2
SHAPES = ("cuboid", "sphere", "capped_cylinder")
SHAPE, X, Y, Z, OMEGA, D1, D2, D3 = range(8)
COLUMNS = ("shape", "x", "y", "z", "omega", "d1", "d2", "d3")


def as_parts(parts: NDArray[np.float64]) -> NDArray[np.float64]:
    """The parts as a contiguous (k, 8) array; raises ValueError for anything that is not a model."""
    array = np.ascontiguousarray(parts, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != len(COLUMNS):
        raise ValueError(f"a model is an array (k, {len(COLUMNS)}), not {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError("a model's parameters must be finite")
    if not np.all(np.isin(array[:, SHAPE], (CUBOID, SPHERE, CAPPED_CYLINDER))):
        raise ValueError(f"a shape is 0, 1 or 2 ({', '.join(SHAPES)}), not {array[:, SHAPE]}")
    return array


def to_trimesh(primitive: NDArray[np.float64], detail: int = 4) -> trimesh.Trimesh:
    """One row of a model as a mesh in the rig frame (m); ``detail`` doubles the facets of round shapes.

    The vertices of round shapes lie on the true surface, so the mesh is never larger than the shape.
    """
    import trimesh  # slow to import, and only pictures and tests need meshes
    from scipy.spatial.transform import Rotation

    row = as_parts(np.asarray(primitive, dtype=np.float64).reshape(1, -1))[0]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.0, 0.0, row[OMEGA]]).as_matrix()
    pose[:3, 3] = row[X : Z + 1]
    mesh: trimesh.Trimesh
    if row[SHAPE] == CUBOID:
        mesh = trimesh.creation.box(extents=(row[D1], row[D3], row[D2]))
    elif row[SHAPE] == SPHERE:
        mesh = trimesh.creation.icosphere(subdivisions=detail, radius=row[D1])
    else:
        facets = 8 * 2**detail
        # Made with radius one: trimesh drops the facets of a small cap as degenerate and leaves a hole.
        mesh = trimesh.creation.capsule(height=row[D2] / row[D1], radius=1.0, count=[facets, facets])
        pose[:3, :3] = pose[:3, :3] @ [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]  # made along its z
        pose[:3, :3] *= row[D1]
    mesh.apply_transform(pose)
    return mesh
