"""Which pixels does a model darken? Exact ray tests, compiled, many pixels at a time.

Only coverage matters: every part has the same luminosity and the background is white, so no depth sorting.
A ray leaves the camera at (eye, 0, 0) along (dx, dy, 1); a part counts only where the ray meets it at t > 0.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.vision._jit import compiled
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import as_parts

WHITE = 255
PART_LUMINOSITY = 96

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@compiled
def cover(
    part: NDArray[np.float64],
    eye: float,
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    out: NDArray[np.uint8],
) -> None:
    """Set ``out`` (K,) to 1 where rays (dx, dy, 1) (K,) from (eye, 0, 0) meet the part (8,), else to 0."""
    # Positions relative to the camera are rounded to float32 (60 nm at one metre) only after the subtraction.
    ux = np.float32(math.cos(part[4]))
    uy = np.float32(math.sin(part[4]))
    cx = np.float32(part[1] - eye)
    cy = np.float32(part[2])
    cz = np.float32(part[3])
    if part[0] == 0.0:
        _cover_cuboid(ux, uy, cx, cy, part, dx, dy, out)
    else:
        # A sphere is a capped cylinder without a cylinder.
        half = np.float32(0.5 * part[6]) if part[0] == 2.0 else np.float32(0.0)
        _cover_capsule(ux, uy, cx, cy, cz, np.float32(part[5]), half, dx, dy, out)


@compiled
def _cover_capsule(
    ux: np.float32,
    uy: np.float32,
    cx: np.float32,
    cy: np.float32,
    cz: np.float32,
    radius: np.float32,
    half: np.float32,
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    out: NDArray[np.uint8],
) -> None:
    """The ray's line passes within ``radius`` of the segment C + s U, -half <= s <= half.

    With A = D x C and B = D x U the squared distance of the point s to the line is |A + s B|^2 / |D|^2: a
    parabola in s, so the clamped vertex is the nearest point. Cross products avoid the cancellation of the
    textbook discriminant. If the nearest point lies behind the camera, the half-line's nearest point is the
    camera itself: then only a camera inside the shape sees it, and it sees nothing else.
    """
    square = radius * radius
    along = min(max(cx * ux + cy * uy, -half), half)
    x, y = cx - along * ux, cy - along * uy
    if x * x + y * y + cz * cz <= square:
        out[:] = 1
        return
    for i in range(dx.size):
        x = dx[i]
        y = dy[i]
        ax = y * cz - cy
        ay = cx - x * cz
        az = x * cy - y * cx
        bz = x * uy - y * ux
        s = (ax * uy - ay * ux - az * bz) / (_ONE + bz * bz)
        s = half if s > half else s
        s = -half if s < -half else s
        ax -= s * uy
        ay += s * ux
        az += s * bz
        near = ax * ax + ay * ay + az * az <= square * (x * x + y * y + _ONE)
        ahead = x * (cx + s * ux) + y * (cy + s * uy) + cz > _ZERO
        out[i] = near & ahead


@compiled
def _cover_cuboid(
    ux: np.float32,
    uy: np.float32,
    cx: np.float32,
    cy: np.float32,
    part: NDArray[np.float64],
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    out: NDArray[np.uint8],
) -> None:
    """The slab test in the rolled frame, without divisions.

    The depth slab cuts the ray to a segment (t > 0 included); seen along the depth axis the question is then
    whether that segment meets a rectangle: three separating axes, the rectangle's and the segment's normal.
    """
    front = max(part[3] - 0.5 * part[6], 0.0)
    back = part[3] + 0.5 * part[6]
    if back <= 0.0:
        out[:] = 0
        return
    middle = np.float32(0.5 * (front + back))
    reach = np.float32(0.5 * (back - front))
    hx = np.float32(0.5 * part[5])
    hy = np.float32(0.5 * part[7])
    px = cx * ux + cy * uy
    py = cy * ux - cx * uy
    for i in range(dx.size):
        x = dx[i] * ux + dy[i] * uy
        y = dy[i] * ux - dx[i] * uy
        ex = abs(x)
        ey = abs(y)
        inside_x = abs(middle * x - px) <= hx + reach * ex
        inside_y = abs(middle * y - py) <= hy + reach * ey
        out[i] = inside_x & inside_y & (abs(x * py - y * px) <= hx * ey + hy * ex)


@compiled
def _luminosity(
    parts: NDArray[np.float64],
    eyes: tuple[float, float],
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    dark: int,
    out: NDArray[np.uint8],
) -> None:
    row = np.empty(dx.size, np.uint8)
    for camera in range(2):
        out[camera] = WHITE
        for k in range(parts.shape[0]):
            cover(parts[k], eyes[camera], dx, dy, row)
            for i in range(row.size):
                out[camera, i] = dark if row[i] else out[camera, i]


def luminosity(
    parts: NDArray[np.float64],
    rig: StereoRig,
    pixels: NDArray[np.integer],
    part_luminosity: int = PART_LUMINOSITY,
) -> NDArray[np.uint8]:
    """The luminosities (2, K), left then right, of the pixels (K, 2) of (u, v) = (column, row).

    ``parts`` (k, 8) is a model (m, rad, rig frame). Raises ValueError for a bad model or a pixel off the
    image.
    """
    pixels = np.asarray(pixels)
    if pixels.ndim != 2 or pixels.shape[1] != 2 or not np.issubdtype(pixels.dtype, np.integer):
        raise ValueError(f"pixels is an integer array (K, 2) of (u, v), not {pixels.dtype} {pixels.shape}")
    if np.any(pixels < 0) or np.any(pixels >= (rig.width, rig.height)):
        raise ValueError(f"a pixel lies outside the image of {rig.width} x {rig.height}")
    rays = rig.rays()[pixels[:, 1], pixels[:, 0]].astype(np.float32)
    out = np.empty((2, len(pixels)), np.uint8)
    dx, dy = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
    _luminosity(as_parts(parts), rig.eyes, dx, dy, part_luminosity, out)
    return out


def render(
    parts: NDArray[np.float64], rig: StereoRig, part_luminosity: int = PART_LUMINOSITY
) -> NDArray[np.uint8]:
    """Both images of a model: (2, height, width) uint8, left then right."""
    rays = rig.rays().astype(np.float32).reshape(-1, 2)
    out = np.empty((2, rig.height * rig.width), np.uint8)
    dx, dy = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
    _luminosity(as_parts(parts), rig.eyes, dx, dy, part_luminosity, out)
    return out.reshape(2, rig.height, rig.width)
