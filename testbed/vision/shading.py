"""What a pinhole camera sees of lit cuboids, balls and capped cylinders: exact ray casting, compiled.

Unlike :mod:`testbed.vision.kernel`, which tells what a model darkens in the upright plane, solids stand here in any
direction, hide one another, and are lit. The shading is that of Bullet's TinyRenderer: for a surface of grey level c,
normal n and light direction l, both in the world's frame, ``c * (ambient + diffuse * max(0, n.l) + specular *
max(0, r_z)^2)``, with r the light's mirrored direction; fractions of a grey level are cut off. There are no shadows.

Rays start in the camera, (0, 0, 0), and pass through (x, y, 1): x to the right, y up, z ahead.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.vision._jit import compiled
from testbed.vision.primitives import CAPPED_CYLINDER, CUBOID

Array = NDArray[np.float64]
Corners = tuple[int, int, int, int]

NEAR = 0.02  # metres ahead of the camera; what is nearer is not seen


@compiled
def _columns(low: float, high: float, lens: float, count: int) -> tuple[int, int]:
    """The first pixel and the one after the last whose rays have a slope between ``low`` and ``high``."""
    first = math.ceil((low / lens + 1.0) * 0.5 * count - 0.5)
    last = math.floor((high / lens + 1.0) * 0.5 * count - 0.5) + 1
    return min(max(first, 0), count), min(max(last, 0), count)


@compiled
def _window(points: Array, margin: float, lens: Array, shape: tuple[int, int]) -> Corners:
    """Rows and columns, first and after the last, that balls of radius ``margin`` about the points (n, 3) can touch."""
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    nearest, farthest = np.inf, -np.inf
    for k in range(points.shape[0]):
        nearest, farthest = min(nearest, points[k, 2] - margin), max(farthest, points[k, 2] + margin)
    if farthest <= NEAR:
        return 0, 0, 0, 0
    if nearest <= NEAR:
        return 0, shape[0], 0, shape[1]
    for k in range(points.shape[0]):
        for side in range(2):
            depth = points[k, 2] + (margin if side else -margin)
            left = min(left, (points[k, 0] - margin) / depth)
            right = max(right, (points[k, 0] + margin) / depth)
            low = min(low, (points[k, 1] - margin) / depth)
            high = max(high, (points[k, 1] + margin) / depth)
    begin, end = _columns(left, right, lens[0], shape[1])
    top, bottom = _columns(-high, -low, lens[1], shape[0])
    return top, bottom, begin, end


@compiled
def _lit(grey: float, nx: float, ny: float, nz: float, sky: Array, light: Array, shares: Array) -> float:
    """The luminosity of a surface of this grey level with this normal; ``sky`` is the world's z axis."""
    facing = nx * light[0] + ny * light[1] + nz * light[2]
    up = 2.0 * facing * (nx * sky[0] + ny * sky[1] + nz * sky[2])
    up -= light[0] * sky[0] + light[1] * sky[1] + light[2] * sky[2]
    share = shares[0] + shares[1] * max(facing, 0.0) + shares[2] * max(up, 0.0) ** 2
    return float(min(255.0, math.floor(grey * share)))


@compiled
def _cast_cuboid(
    turn: Array,
    centre: Array,
    half: Array,
    grey: float,
    sky: Array,
    light: Array,
    shares: Array,
    lens: Array,
    depth: NDArray[np.float32],
    out: NDArray[np.float32],
) -> Corners:
    """Three slabs in the cuboid's own frame; the last one entered is the face that is seen. Returns its window.

    ``turn`` (3, 3) has the cuboid's axes as its rows, in the camera's frame, and ``half`` (3,) its half sides.
    """
    height, width = depth.shape
    corners = np.empty((8, 3))
    for k in range(8):
        for axis in range(3):
            corners[k, axis] = centre[axis]
            for side in range(3):
                corners[k, axis] += (1.0 if k >> side & 1 else -1.0) * half[side] * turn[side, axis]
    top, bottom, begin, end = _window(corners, 0.0, lens, (height, width))
    faces, place = np.empty((3, 2)), np.empty(3)
    for axis in range(3):
        x, y, z = turn[axis, 0], turn[axis, 1], turn[axis, 2]
        faces[axis, 0] = _lit(grey, -x, -y, -z, sky, light, shares)
        faces[axis, 1] = _lit(grey, x, y, z, sky, light, shares)
        place[axis] = x * centre[0] + y * centre[1] + z * centre[2]
    for row in range(top, bottom):
        y = (1.0 - (2.0 * row + 1.0) / height) * lens[1]
        met = False
        for column in range(begin, end):
            x = ((2.0 * column + 1.0) / width - 1.0) * lens[0]
            enter, leave, face, side = NEAR, np.inf, -1, 0
            for axis in range(3):
                way = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2]
                if way == 0.0:  # along the slab: inside it for ever, or never
                    leave = leave if abs(place[axis]) <= half[axis] else -1.0
                    continue
                reach = half[axis] if way > 0.0 else -half[axis]
                if (place[axis] - reach) / way > enter:
                    enter, face, side = (place[axis] - reach) / way, axis, 0 if way > 0.0 else 1
                leave = min(leave, (place[axis] + reach) / way)
                if enter > leave:
                    break
            if enter > leave:
                if met:
                    break  # what is convex is met by neighbours in a row
                continue
            met = True
            if face >= 0 and enter < depth[row, column]:
                depth[row, column] = enter
                out[row, column] = faces[face, side]
    return top, bottom, begin, end


@compiled
def _cast_capsule(
    ends: Array,
    radius: float,
    grey: float,
    sky: Array,
    light: Array,
    shares: Array,
    lens: Array,
    depth: NDArray[np.float32],
    out: NDArray[np.float32],
) -> Corners:
    """All points within ``radius`` of the segment between two ends (2, 3): a cylinder and two balls, or one ball.

    Returns its window.
    """
    height, width = depth.shape
    top, bottom, begin, end = _window(ends, radius, lens, (height, width))
    ax, ay, az = ends[0, 0], ends[0, 1], ends[0, 2]
    ux, uy, uz = ends[1, 0] - ax, ends[1, 1] - ay, ends[1, 2] - az
    span = ux * ux + uy * uy + uz * uz  # the square of its length
    a_u, a_a = ax * ux + ay * uy + az * uz, ax * ax + ay * ay + az * az
    square = radius * radius
    for row in range(top, bottom):
        y = (1.0 - (2.0 * row + 1.0) / height) * lens[1]
        met = False
        for column in range(begin, end):
            x = ((2.0 * column + 1.0) / width - 1.0) * lens[0]
            ray = x * x + y * y + 1.0
            along = ux * x + uy * y + uz
            ahead = ax * x + ay * y + az
            # Where the endless cylinder is entered, and where on the segment that is, from 0 to span.
            a = span * ray - along * along
            where = -1.0 if along > 0.0 else span + 1.0  # a ray along the axis meets the nearer ball
            t = 0.0
            if a > 1e-12 * span * ray:
                b = a_u * along - span * ahead
                rest = b * b - a * (span * a_a - a_u * a_u - square * span)
                if rest < 0.0:
                    if met:
                        break  # what is convex is met by neighbours in a row
                    continue
                t = -(b + math.sqrt(rest)) / a
                where = t * along - a_u
            if where < 0.0 or where > span:  # not on the cylinder's own part: the ball on that side
                far = 0.0 if where < 0.0 else 1.0
                cx, cy, cz = ax + far * ux, ay + far * uy, az + far * uz
                b = cx * x + cy * y + cz
                rest = b * b - ray * (cx * cx + cy * cy + cz * cz - square)
                if rest < 0.0:
                    if met:
                        break  # what is convex is met by neighbours in a row
                    continue
                t = (b - math.sqrt(rest)) / ray
                where = far * span
            met = met or t > 0.0
            if t > NEAR and t < depth[row, column]:
                depth[row, column] = t
                share = where / span if span > 0.0 else 0.0
                nx = (t * x - ax - share * ux) / radius
                ny = (t * y - ay - share * uy) / radius
                nz = (t - az - share * uz) / radius
                out[row, column] = _lit(grey, nx, ny, nz, sky, light, shares)
    return top, bottom, begin, end


@compiled
def _axes(x: float, y: float, z: float, w: float, out: Array) -> None:
    """The axes (3, 3), one a row, of a frame turned by a quaternion."""
    out[0, 0] = 1 - 2 * (y * y + z * z)
    out[0, 1] = 2 * (x * y + z * w)
    out[0, 2] = 2 * (x * z - y * w)
    out[1, 0] = 2 * (x * y - z * w)
    out[1, 1] = 1 - 2 * (x * x + z * z)
    out[1, 2] = 2 * (y * z + x * w)
    out[2, 0] = 2 * (x * z + y * w)
    out[2, 1] = 2 * (y * z - x * w)
    out[2, 2] = 1 - 2 * (x * x + y * y)


@compiled
def cast(
    solids: Array,
    poses: Array,
    turned: Array,
    eye: Array,
    lens: Array,
    light: Array,
    shares: Array,
    depth: NDArray[np.float32],
    out: NDArray[np.float32],
) -> Corners:
    """Draw solids into a picture.

    Args:
        solids: (n, 5) shape (as in :mod:`testbed.vision.primitives`), three sizes (m), luminosity under full light.
            The sizes are a cuboid's sides; a ball's radius; a capped cylinder's radius and length, along its x axis.
        poses: (n, 7) centre (m) and quaternion xyzw in the world.
        turned: (3, 3) what is to the right, up and ahead of the camera, as unit vectors in the world.
        eye: (3,) where the camera is in the world (m).
        lens: (2,) slope of the rays at the right and at the upper rim.
        light: (3,) unit vector toward the light, in the world.
        shares: (3,) ambient, diffuse and specular.
        depth: (H, W) metres ahead of what is in the picture already, infinite where nothing is; changed in place.
        out: (H, W) luminosities, the background already in them; changed in place.

    Returns:
        Rows and columns, first and after the last, outside of which nothing was drawn.
    """
    height, width = depth.shape
    top, bottom, begin, end = height, 0, width, 0
    lamp, sky, centre, half = np.zeros(3), np.empty(3), np.empty(3), np.empty(3)
    axes, turn, ends = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 3))
    for axis in range(3):
        sky[axis] = turned[axis, 2]
        for i in range(3):
            lamp[axis] += turned[axis, i] * light[i]
    for k in range(solids.shape[0]):
        _axes(poses[k, 3], poses[k, 4], poses[k, 5], poses[k, 6], axes)
        for axis in range(3):
            centre[axis] = 0.0
            for i in range(3):
                centre[axis] += turned[axis, i] * (poses[k, i] - eye[i])
                turn[i, axis] = 0.0
                for j in range(3):
                    turn[i, axis] += axes[i, j] * turned[axis, j]
        grey = solids[k, 4]
        if solids[k, 0] == CUBOID:
            for axis in range(3):
                half[axis] = 0.5 * solids[k, 1 + axis]
            window = _cast_cuboid(turn, centre, half, grey, sky, lamp, shares, lens, depth, out)
        else:
            reach = 0.5 * solids[k, 2] if solids[k, 0] == CAPPED_CYLINDER else 0.0
            for axis in range(3):
                ends[0, axis] = centre[axis] - reach * turn[0, axis]
                ends[1, axis] = centre[axis] + reach * turn[0, axis]
            window = _cast_capsule(ends, solids[k, 1], grey, sky, lamp, shares, lens, depth, out)
        if window[0] < window[1] and window[2] < window[3]:
            top, bottom = min(top, window[0]), max(bottom, window[1])
            begin, end = min(begin, window[2]), max(end, window[3])
    return top, bottom, begin, end
