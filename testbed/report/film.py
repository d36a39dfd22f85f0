"""A body seen by a pinhole camera, painted on pixels: quick enough for every frame of a video.

Bullet's software renderer takes two microseconds a pixel, which would make a short video last minutes. Cuboids,
spheres and capped cylinders need no renderer: visible faces and outlines, painted from the farthest to the
nearest, over a floor with lines and a soft shadow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Cuboid, Mesh, Morphology, Part, Vector
from testbed.report.drawing import CORNERS, light_on, paint_order

Frame = NDArray[np.uint8]
Colour = tuple[int, int, int]

GRID = 0.10
"""Distance of the floor's lines, m."""

_FIELD = math.radians(36)
_PAPER: Colour = (254, 254, 254)
_LINE: Colour = (228, 232, 237)
_SHADOW: Colour = (214, 219, 225)
_AROUND = np.stack(
    [np.cos(np.linspace(0, 2 * np.pi, 41)[:-1]), np.sin(np.linspace(0, 2 * np.pi, 41)[:-1])], axis=1
)
_SUBPIXEL = 4  # binary digits after the point that cv2 draws with


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        eye: (3,) where it is, m.
        axes: (3, 3) rows: right, down and ahead.
        size: Width and height of the picture in pixels.
    """

    eye: Vector
    axes: Vector
    size: tuple[int, int]

    @classmethod
    def towards(cls, eye: Vector, target: Vector, size: tuple[int, int]) -> Self:
        """A camera at ``eye`` that looks at ``target``, upright."""
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return cls(eye, np.stack([right, np.cross(ahead, right), ahead]), size)

    @classmethod
    def watching(cls, body: Morphology, base: Vector, size: tuple[int, int]) -> Self:
        """A camera that has all of a path (steps, 7) in view, the body's x axis pointing to the right."""
        x, y, z, w = base[0, 3:]
        heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        right = np.array([math.cos(heading), math.sin(heading), 0.0])
        ahead = np.array([-math.sin(heading), math.cos(heading), 0.0])
        low, high, _ = body.reach()
        path = (base[:, :3] - base[0, :3]) @ right
        left_end, right_end = path.min() + low - 0.05, path.max() + high + 0.05
        target = base[0, :3] + right * (left_end + right_end) / 2
        target[2] = 0.07
        away = max(0.5, (right_end - left_end) / 2 / math.tan(_FIELD / 2))
        eye = target + away * (np.array([0.0, 0.0, 0.36]) - 0.93 * ahead - 0.10 * right)
        return cls.towards(eye, target, size)

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.size[0] / 2 / math.tan(_FIELD / 2)

    def project(self, points: Vector) -> tuple[Vector, Vector]:
        """Where points (n, 3) appear: pixels (n, 2) and depths (n,) m."""
        seen = (points - self.eye) @ self.axes.T
        depth = np.maximum(seen[:, 2], 1e-3)
        return seen[:, :2] * (self.focal / depth)[:, None] + np.array(self.size) / 2, depth


def floor(camera: Camera) -> Frame:
    """White paper with a floor's lines every 10 cm, fading with distance."""
    image = np.full((camera.size[1], camera.size[0], 3), _PAPER, np.uint8)
    middle = (
        np.round((camera.eye + camera.axes[2] / max(-camera.axes[2, 2], 0.2) * camera.eye[2])[:2] / GRID)
        * GRID
    )
    offsets = np.arange(-14, 15) * GRID
    for offset in offsets:
        for direction in (np.array([1.0, 0.0]), np.array([0.0, 1.0])):
            across = direction[::-1]
            along = np.linspace(-14, 14, 113)[:, None] * GRID
            points = np.c_[middle + offset * across + along * direction, np.zeros(len(along))]
            pixels, depth = camera.project(points)
            for start in range(len(along) - 1):
                if min(depth[start], depth[start + 1]) > 0.1:
                    fade = min(1.0, (float(np.linalg.norm(points[start, :2] - middle)) / 1.1) ** 2)
                    shade = tuple(
                        int(line + (paper - line) * fade) for line, paper in zip(_LINE, _PAPER, strict=True)
                    )
                    ends = _fixed(pixels[start : start + 2])
                    cv2.line(image, ends[0].tolist(), ends[1].tolist(), shade, 2, cv2.LINE_AA, _SUBPIXEL)
    return image


def paint(
    image: Frame, camera: Camera, body: Morphology, poses: Mapping[str, Vector], colour: Colour
) -> None:
    """Paint a body whose parts have these (4, 4) world poses (m) over the picture."""
    _paint_shadow(image, camera, body, poses)
    toward = camera.eye - poses[body.root][:3, 3]
    for name in paint_order(body, poses, toward / np.linalg.norm(toward)):
        _paint_part(image, camera, body.parts[name], poses[name], colour)


def _paint_shadow(image: Frame, camera: Camera, body: Morphology, poses: Mapping[str, Vector]) -> None:
    """The parts' shadows on the floor in a light from the upper left."""
    soft = image.shape[1] / 160
    shadow = np.zeros(image.shape[:2], np.uint8)
    outlines = []
    for name, pose in poses.items():
        points = _surface(body.parts[name], pose)
        points = points + points[:, 2:] * np.array([0.25, 0.12, -1.0])
        outlines.append(camera.project(points)[0])
        cv2.fillConvexPoly(shadow, _hull(outlines[-1]), 255, cv2.LINE_AA, _SUBPIXEL)
    every = np.concatenate(outlines)
    low = np.clip(every.min(axis=0) - 4 * soft, 0, camera.size).astype(int)
    high = np.clip(every.max(axis=0) + 4 * soft, 0, camera.size).astype(int)
    if np.any(high <= low):
        return
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    weight = cv2.GaussianBlur(shadow[window], (0, 0), soft).astype(np.float32)[..., None] / 255
    lit = image[window]
    image[window] = (lit * (1 - weight) + np.minimum(lit, _SHADOW) * weight).astype(np.uint8)


def _paint_part(image: Frame, camera: Camera, part: Part, pose: Vector, colour: Colour) -> None:
    if isinstance(part, Cuboid):
        for axis in range(3):
            for sign in (-1, 1):
                corners = CORNERS[CORNERS[:, axis] == sign / 2] * np.array(part.size)
                corners = corners @ pose[:3, :3].T + pose[:3, 3]
                normal = sign * pose[:3, axis]
                if float(normal @ (corners.mean(axis=0) - camera.eye)) < 0:
                    _fill(image, camera.project(corners)[0], _shaded(colour, light_on(normal)))
        return
    if isinstance(part, Mesh):
        from testbed.report.mesh_drawing import seen_triangles, triangles_of  # meshes are slow to load

        toward = camera.eye - pose[:3, 3]
        faces = seen_triangles(*triangles_of(part, pose, coarse=True), toward / np.linalg.norm(toward))
        for corners, normal in zip(*faces, strict=True):
            _fill(image, camera.project(corners)[0], _shaded(colour, light_on(normal)), outline=False)
        return
    length = getattr(part, "length", 0.0)
    ends = pose[:3, 3] + np.outer([-length / 2, length / 2], pose[:3, 0])
    pixels, depth = camera.project(ends)
    radii = camera.focal * part.radius / depth
    # Bands from the dark rim to the highlight make a round limb look round.
    for share, lift, tone in ((1.0, 0.0, -0.22), (0.86, 0.05, -0.05), (0.62, 0.16, 0.12), (0.3, 0.3, 0.34)):
        circles = [
            pixel + radius * (share * _AROUND - np.array([0.0, lift]))
            for pixel, radius in zip(pixels, radii, strict=True)
        ]
        _fill(image, np.concatenate(circles), _shaded(colour, tone), outline=share == 1.0)


def _fill(image: Frame, points: Vector, colour: Colour, *, outline: bool = True) -> None:
    hull = _hull(points)
    cv2.fillConvexPoly(image, hull, colour, cv2.LINE_AA, _SUBPIXEL)
    if outline:
        cv2.polylines(image, [hull], True, _shaded(colour, -0.45), 1, cv2.LINE_AA, _SUBPIXEL)


def _shaded(colour: Colour, amount: float) -> Colour:
    goal = 255 if amount > 0 else 0
    red, green, blue = (round(channel + (goal - channel) * min(abs(amount), 0.8)) for channel in colour)
    return red, green, blue


def _hull(points: Vector) -> NDArray[np.int32]:
    return np.asarray(cv2.convexHull(_fixed(points)), dtype=np.int32)


def _fixed(points: Vector) -> NDArray[np.int32]:
    scaled = np.clip(np.round(points * 2**_SUBPIXEL), -(2**24), 2**24)
    return np.asarray(scaled, dtype=np.int32)


def _surface(part: Part, pose: Vector) -> Vector:
    if isinstance(part, Cuboid):
        return np.asarray((CORNERS * np.array(part.size)) @ pose[:3, :3].T + pose[:3, 3])
    if isinstance(part, Mesh):
        return np.asarray(part.points @ pose[:3, :3].T + pose[:3, 3])
    length = getattr(part, "length", 0.0)
    ends = pose[:3, 3] + np.outer([-length / 2, length / 2], pose[:3, 0])
    ball = np.concatenate([np.insert(_AROUND[::3], axis, 0.0, axis=1) for axis in range(3)])
    return np.concatenate([end + part.radius * ball for end in ends])
