"""The meshes of a part: what is seen of it, and the convex pieces that touch the ground."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import QhullError

from testbed.bodies.collada_reading import read_collada
from testbed.bodies.parts import Vector
from testbed.bodies.urdf_reading import Geometry
from testbed.errors import UserError

MESH_SUFFIXES = (".stl", ".obj", ".dae", ".ply", ".off", ".glb")
_LARGEST_MESH = 1 << 26  # bytes
_CONVEX_ENOUGH = 0.5
"""A mesh that fills less of its convex hull than this is taken apart into convex pieces."""
_MOST_PIECES, _MOST_CORNERS, _VOXELS = 8, 32, 10_000
_DIRECTIONS = 96
"""A convex piece keeps its farthest corners in so many directions: a detailed one makes Bullet thirty times slower."""
_SMALLEST = 1e-9  # m3
_THINNEST = 1e-3  # m
_FLAT = 1e-9
"""A hull that fills less of the cube of its size than this has no volume to reckon with: a centre of mass, say."""


@dataclass(frozen=True)
class Shape:
    """A part's shape, in metres in the part's frame.

    Attributes:
        seen: What a camera sees.
        hulls: The convex pieces that touch other things.
    """

    seen: trimesh.Trimesh
    hulls: tuple[trimesh.Trimesh, ...]

    @cached_property
    def points(self) -> Vector:
        """(n, 3) corners of the convex hull of all."""
        every = np.concatenate([self.seen.vertices, *(hull.vertices for hull in self.hulls)])
        return np.asarray(trimesh.convex.convex_hull(every).vertices, dtype=float)

    @cached_property
    def volume(self) -> float:
        """Of the pieces, m3."""
        return max(sum(abs(float(hull.volume)) for hull in self.hulls), _SMALLEST)

    @cached_property
    def centre(self) -> Vector:
        """(3,) of mass, if it is equally dense everywhere."""
        weights = np.array([max(abs(float(hull.volume)), _SMALLEST) for hull in self.hulls])
        centres = np.array([hull.center_mass for hull in self.hulls])
        return np.asarray(weights @ centres / weights.sum())

    @cached_property
    def moments(self) -> Vector:
        """(3,) of inertia about the part's axes through the centre of mass at a density of 1, m5."""
        total = np.zeros(3)
        for hull in self.hulls:
            away = np.asarray(hull.center_mass) - self.centre
            volume = max(abs(float(hull.volume)), _SMALLEST)
            total += np.abs(np.diag(hull.moment_inertia)) + volume * (away @ away - away**2)
        return np.asarray(np.maximum(total, self.volume * 1e-6))


def shape_of_pieces(
    seen: Sequence[tuple[Geometry, Vector]],
    felt: Sequence[tuple[Geometry, Vector]],
    *,
    whole: bool = False,
) -> Shape:
    """The shape of a part.

    Args:
        seen: What is seen, each piece with its pose (4, 4) in the part's frame.
        felt: What is touched, likewise.
        whole: Take nothing apart, which is quicker.
    """
    placed = [_placed(piece, pose) for piece, pose in seen]
    corners = np.cumsum([0, *(len(mesh.vertices) for mesh in placed)])
    shown = trimesh.Trimesh(
        np.concatenate([mesh.vertices for mesh in placed]),
        np.concatenate([mesh.faces + first for mesh, first in zip(placed, corners, strict=False)]),
        process=False,
    )
    hulls = [hull for piece, pose in felt for hull in _convex(_placed(piece, pose), whole=whole)]
    return Shape(shown, tuple(hulls))


def _placed(piece: Geometry, pose: Vector) -> trimesh.Trimesh:
    mesh: trimesh.Trimesh = _mesh(piece).copy()
    mesh.apply_transform(pose)
    return mesh


def _mesh(piece: Geometry) -> Any:  # trimesh's types are loose
    if piece.kind == "box":
        return trimesh.creation.box(piece.sizes)
    if piece.kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=2, radius=piece.sizes[0])
    if piece.kind == "cylinder":
        return trimesh.creation.cylinder(piece.sizes[0], piece.sizes[1], sections=24)
    if piece.kind == "capsule":
        capsule = trimesh.creation.capsule(piece.sizes[1], piece.sizes[0], count=[12, 12])
        capsule.apply_translation(-capsule.bounds.mean(axis=0))
        return capsule
    assert piece.file is not None, "a mesh has a file"
    mesh = load_mesh(piece.file).copy()
    mesh.apply_transform(np.diag([*piece.sizes, 1.0]))
    return mesh


def load_mesh(path: Path) -> trimesh.Trimesh:
    """A mesh file, without its colours.

    Raises:
        UserError: If it cannot be read or holds no surface.
    """
    state = path.stat()
    return _loaded(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=128)
def _loaded(path: Path, changed: int, size: int) -> trimesh.Trimesh:
    if path.suffix.lower() not in MESH_SUFFIXES:
        mend = f"convert it to one of {', '.join(MESH_SUFFIXES)}"
        raise UserError(f"{path.suffix or 'nameless'} meshes are not read", mend, file=path)
    if size > _LARGEST_MESH:
        raise UserError("the mesh has more than 64 MB", "give a coarser one", file=path)
    try:
        surface = _surface(path.read_bytes(), path)
    except UserError:
        raise
    except Exception as error:  # readers of a dozen formats fail in as many ways
        raise UserError(
            f"the mesh cannot be read ({type(error).__name__})", "export it anew", file=path
        ) from None
    if not len(surface.faces) or not np.isfinite(surface.vertices).all():
        raise UserError("the mesh holds no surface", "export it anew", file=path)
    return surface


def _surface(raw: bytes, path: Path) -> trimesh.Trimesh:
    kind = path.suffix.lower()[1:]
    if kind == "dae":
        return read_collada(raw, path)
    mesh: Any = trimesh.load(io.BytesIO(raw), file_type=kind, force="mesh", skip_materials=True)
    return trimesh.Trimesh(mesh.vertices, mesh.faces)


@np.errstate(invalid="ignore", divide="ignore")  # flat ones have no centre of mass
def _convex(mesh: trimesh.Trimesh, *, whole: bool) -> list[trimesh.Trimesh]:
    """Convex pieces that together are about the mesh: its hull where that is near enough."""
    hull = _hull(mesh)
    if whole or abs(float(mesh.volume)) >= _CONVEX_ENOUGH * abs(float(hull.volume)):
        return [hull]
    pieces = mesh.convex_decomposition(
        maxConvexHulls=_MOST_PIECES, maxNumVerticesPerCH=_MOST_CORNERS, resolution=_VOXELS
    )
    return [piece for piece in pieces if abs(float(piece.volume)) > _SMALLEST] or [hull]


def _hull(mesh: trimesh.Trimesh) -> Any:
    try:
        hull = mesh.convex_hull
        corners = np.asarray(hull.vertices)
        farthest = np.unique(np.argmax(corners @ _directions().T, axis=0))
        if len(farthest) < len(corners):
            hull = trimesh.convex.convex_hull(corners[farthest])
        if abs(float(hull.volume)) > _FLAT * float(hull.area) ** 1.5:
            return hull
    except QhullError:
        pass
    plate = trimesh.creation.box(np.maximum(mesh.extents, _THINNEST))  # it is flat
    plate.apply_translation(mesh.bounds.mean(axis=0))
    return plate


def _directions() -> Vector:
    """(n, 3) directions, evenly around: a spiral from pole to pole."""
    steps = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1 - 2 * steps / _DIRECTIONS, math.pi * (1 + math.sqrt(5)) * steps
    level = np.sqrt(1 - z**2)
    return np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
