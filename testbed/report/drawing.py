"""Bodies drawn with their true shapes: a small orthographic draughtsman.

A cuboid seen from anywhere is its visible faces, a capped cylinder the outline of two circles: vector drawings
that stay crisp at any size. Parts are painted from the farthest to the nearest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from testbed.bodies.morphology import Cuboid, Mesh, Morphology, Part, Vector
from testbed.report.style import INK, OF_PART, SHADOW

_CIRCLE = np.stack(
    [np.cos(np.linspace(0, 2 * np.pi, 49)[:-1]), np.sin(np.linspace(0, 2 * np.pi, 49)[:-1])], axis=1
)
_BRIGHT, _DARK = "#ffffff", "#000000"  # light and shade, the same on light and on dark paper
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2


@dataclass(frozen=True)
class View:
    """Where the draughtsman stands, far away: azimuth about z from x, elevation above the ground, in degrees."""

    azimuth_deg: float
    elevation_deg: float

    @property
    def basis(self) -> Vector:
        """(3, 3) rows: to the right on paper, up on paper, towards the viewer."""
        a, e = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        toward = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        return np.stack([right, np.cross(toward, right), toward])

    def flat(self, points: NDArray[np.floating]) -> Vector:
        """(n, 3) points in metres on paper: (n, 2)."""
        return np.asarray(points @ self.basis[:2].T)


SIDE, TOP, OBLIQUE = View(-90, 0), View(-90, 90), View(-62, 28)


def draw_body(
    axes: Axes,
    body: Morphology,
    poses: Mapping[str, Vector],
    view: View,
    *,
    shadow: bool = True,
    alpha: float = 1.0,
    colours: Sequence[str] = OF_PART,
) -> None:
    """Draw a body whose parts have these (4, 4) poses (m); the ground is z = 0."""
    toward = view.basis[2]
    if shadow and view.elevation_deg > 1:
        for name, pose in poses.items():
            ground = _sample(body.parts[name], pose) * np.array([1.0, 1.0, 0.0])
            _polygon(axes, _hull(view.flat(ground)), SHADOW, zorder=1)
    names = list(body.parts)
    for order, name in enumerate(paint_order(body, poses, toward)):
        colour = colours[names.index(name) % len(colours)]
        _draw_part(axes, body.parts[name], poses[name], view, colour, 3 + order, alpha)


def paint_order(body: Morphology, poses: Mapping[str, Vector], toward: Vector) -> list[str]:
    """Names of the parts from the farthest to the nearest for a viewer in direction ``toward`` (3,).

    Centres alone would order a long limb wrongly against a wide main body: a limb beyond a face of the main body
    is in front of it if that face is seen, and behind it if not.
    """

    def place(name: str) -> tuple[int, float]:
        side = 0 if name == body.root else _side(body, poses, name, toward)
        return side, float(poses[name][:3, 3] @ toward)

    return sorted(poses, key=place)


def _side(body: Morphology, poses: Mapping[str, Vector], name: str, toward: Vector) -> int:
    """1 if a part is in front of the root, -1 if it is behind."""
    root, pose = body.parts[body.root], poses[body.root]
    if not isinstance(root, Cuboid):
        return 1 if float((poses[name] - pose)[:3, 3] @ toward) > 0 else -1
    inside = (_sample(body.parts[name], poses[name]) - pose[:3, 3]) @ pose[:3, :3]
    gaps = np.stack([inside.min(axis=0), -inside.max(axis=0)]) - np.array(root.size) / 2
    sign, axis = np.unravel_index(int(np.argmax(gaps)), gaps.shape)
    normal = pose[:3, axis] * (1 if sign == 0 else -1)
    return 1 if float(normal @ toward) > 1e-9 else -1


def grounded(body: Morphology, poses: Mapping[str, Vector]) -> dict[str, Vector]:
    """The same poses lifted or lowered until the lowest point touches the ground."""
    lowest = min(pose[2, 3] + body.parts[name].span(pose[2, :3])[0] for name, pose in poses.items())
    lift = np.zeros((4, 4))
    lift[2, 3] = -lowest
    return {name: pose + lift for name, pose in poses.items()}


def tilted(body: Morphology, angles: NDArray[np.floating], tilt: NDArray[np.floating]) -> dict[str, Vector]:
    """The body on the ground with these joint angles (rad) and this tilt of its root (2,) (rad)."""
    side, nose = float(tilt[0]), float(tilt[1])
    c, s = math.cos(side), math.sin(side)
    roll = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])
    c, s = math.cos(nose), math.sin(nose)
    pitch = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])
    return grounded(
        body, {name: pitch @ roll @ pose for name, pose in body.poses(angles.astype(float)).items()}
    )


def flat_on_ground(body: Morphology) -> dict[str, Vector]:
    """The body lying flat."""
    return tilted(body, np.zeros(len(body.joints)), np.zeros(2))


def extent(body: Morphology, poses: Mapping[str, Vector], view: View) -> Vector:
    """(2, 2): lower and upper corner on paper of everything that is drawn."""
    points = np.concatenate([view.flat(_sample(body.parts[name], pose)) for name, pose in poses.items()])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def frame(axes: Axes, corners: NDArray[np.floating], margin: float = 0.02) -> None:
    """Show everything between the corners (2, 2), to scale."""
    axes.set_xlim(corners[0, 0] - margin, corners[1, 0] + margin)
    axes.set_ylim(corners[0, 1] - margin, corners[1, 1] + margin)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_part(
    axes: Axes, part: Part, pose: Vector, view: View, colour: str, order: float, alpha: float
) -> None:
    if isinstance(part, Cuboid):
        for axis in range(3):
            for sign in (-1, 1):
                normal = sign * pose[:3, axis]
                if float(normal @ view.basis[2]) > 1e-9:
                    corners = CORNERS[CORNERS[:, axis] == sign / 2] * np.array(part.size)
                    outline = _hull(view.flat(corners @ pose[:3, :3].T + pose[:3, 3]))
                    _polygon(axes, outline, colour, zorder=order, edge=True, alpha=alpha)
                    _shade(axes, outline, light_on(normal), order + 0.2)
        return
    if isinstance(part, Mesh):
        from testbed.report.mesh_drawing import draw_mesh  # meshes are slow to load

        draw_mesh(axes, part, pose, view.basis, colour, order, alpha)
        return
    length = getattr(part, "length", 0.0)
    ends = pose[:3, 3] + np.outer([-length / 2, length / 2], pose[:3, 0])
    flat = view.flat(ends)
    _polygon(axes, _stadium(flat, part.radius), colour, zorder=order, edge=True, alpha=alpha)
    shine = flat + np.array([-0.18, 0.34]) * part.radius
    _polygon(axes, _stadium(shine, part.radius * 0.36), _BRIGHT, zorder=order + 0.2, alpha=0.28 * alpha)


def light_on(normal: Vector) -> float:
    """How much lighter (positive) or darker a face is than its colour."""
    return 0.34 * float(normal[2]) + 0.10 * float(normal[0]) - 0.06


def _shade(axes: Axes, outline: Vector, amount: float, order: float) -> None:
    _polygon(axes, outline, _BRIGHT if amount > 0 else _DARK, zorder=order, alpha=min(abs(amount), 0.4))


def _polygon(
    axes: Axes, outline: Vector, colour: str, *, zorder: float, edge: bool = False, alpha: float = 1.0
) -> None:
    axes.add_patch(
        Polygon(
            outline,
            closed=True,
            facecolor=colour,
            edgecolor=INK if edge else "none",
            linewidth=0.55 if edge else 0.0,
            joinstyle="round",
            alpha=alpha,
            zorder=zorder,
        )
    )


def _stadium(ends: Vector, radius: float) -> Vector:
    return _hull(np.concatenate([end + radius * _CIRCLE for end in ends]))


def _hull(points: Vector) -> Vector:
    spread = np.ptp(points, axis=0)
    if spread.min() < 1e-9:
        return points[[np.argmin(points.sum(axis=1)), np.argmax(points.sum(axis=1))]]
    return np.asarray(points[ConvexHull(points).vertices])


def _sample(part: Part, pose: Vector) -> Vector:
    """(n, 3) points whose hull is nearly the part."""
    if isinstance(part, Cuboid):
        points = CORNERS * np.array(part.size)
        return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])
    if isinstance(part, Mesh):
        return np.asarray(part.points @ pose[:3, :3].T + pose[:3, 3])
    length = getattr(part, "length", 0.0)
    ends = pose[:3, 3] + np.outer([-length / 2, length / 2], pose[:3, 0])
    around = np.linspace(0, 2 * np.pi, 17)[:-1]
    ball = np.array(
        [
            [math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)]
            for a in around
            for e in (-1.2, -0.6, 0.0, 0.6, 1.2)
        ]
    )
    return np.concatenate([end + part.radius * ball for end in ends])
