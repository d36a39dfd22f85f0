"""Exact area coverage of convex outlines, compiled: how much of each pixel a shape covers.

The way of font rasterisers: every edge of an outline leaves its signed area in the pixels that it crosses, and a
running sum along each row turns that into coverage. The work grows with the outline, not with the area, and the
result is continuous in every coordinate, so that it can be differentiated by small steps.

Image coordinates are in pixels with the origin in the upper left corner: pixel (u, v) covers [u, u+1] x [v, v+1].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.vision._jit import compiled

CORNERS = 24
"""Room for the corners of one outline."""
NEAREST = 0.02
"""What is nearer to the eye than this (m) is not drawn."""
_CAP = 1.0 / math.sqrt(math.sin(math.pi / 4) / (math.pi / 4))
_ROUNDER_CAP = 1.0 / math.sqrt(math.sin(math.pi / 8) / (math.pi / 8))
_THICK = 2.0
"""From this radius on (pixels) a cap has eight edges in place of four, which then cut off up to a tenth of a pixel."""
_BALL = 16


@compiled
def outline(
    shape: int,
    centre: NDArray[np.float64],
    axes: NDArray[np.float64],
    size: NDArray[np.float64],
    eye: float,
    camera: NDArray[np.float64],
    px: NDArray[np.float64],
    py: NDArray[np.float64],
) -> int:
    """Corners of what an eye sees of one part; returns their number, 0 if the part is not in front of the eye.

    ``centre`` (3,) and ``axes`` (3, 3; rows: own x, y, z) in the rig's frame; ``size`` (3,) as in Eq. 2 (cuboid:
    length along own x, width along own y, height along own z; sphere: radius; capped cylinder: radius, length);
    ``camera`` (3,) focal length and the image's middle in pixels. Round outlines are polygons of the same area.
    """
    focal, cu, cv = camera[0], camera[1], camera[2]
    if shape == 0:
        n = 0
        bx = np.empty(8)
        by = np.empty(8)
        for a in (-0.5, 0.5):
            for b in (-0.5, 0.5):
                for c in (-0.5, 0.5):
                    sa, sb, sc = a * size[0], b * size[1], c * size[2]
                    z = centre[2] + sa * axes[0, 2] + sb * axes[1, 2] + sc * axes[2, 2]
                    if z < NEAREST:
                        return 0
                    x = centre[0] + sa * axes[0, 0] + sb * axes[1, 0] + sc * axes[2, 0] - eye
                    y = centre[1] + sa * axes[0, 1] + sb * axes[1, 1] + sc * axes[2, 1]
                    bx[n] = focal * x / z + cu
                    by[n] = focal * y / z + cv
                    n += 1
        return _hull(bx, by, px, py)
    if shape == 1:
        if centre[2] < NEAREST + size[0]:
            return 0
        return _ball(centre[0] - eye, centre[1], centre[2], size[0], camera, px, py)
    half = 0.5 * size[1]
    za = centre[2] - half * axes[0, 2]
    zb = centre[2] + half * axes[0, 2]
    if za < NEAREST + size[0] or zb < NEAREST + size[0]:
        return 0
    ax = focal * (centre[0] - half * axes[0, 0] - eye) / za + cu
    ay = focal * (centre[1] - half * axes[0, 1]) / za + cv
    ex = focal * (centre[0] + half * axes[0, 0] - eye) / zb + cu
    ey = focal * (centre[1] + half * axes[0, 1]) / zb + cv
    ra = focal * size[0] / za
    rb = focal * size[0] / zb
    dx, dy = ex - ax, ey - ay
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        dx, dy = 1.0, 0.0
    else:
        dx, dy = dx / distance, dy / distance
    thick = max(ra, rb) > _THICK
    edges = 8 if thick else 4
    for i in range(edges + 1):
        angle = (i - edges // 2) * math.pi / edges
        grown = 1.0 if i == 0 or i == edges else _ROUNDER_CAP if thick else _CAP
        c = math.cos(angle) * dx - math.sin(angle) * dy
        s = math.cos(angle) * dy + math.sin(angle) * dx
        # Off the optical axis an image is stretched: a tangent at a distance h from the middle moves out by this.
        h = (c * (ex - cu) + s * (ey - cv)) / focal
        wide = rb * grown * math.sqrt(1.0 + h * h)
        px[i] = ex + wide * c
        py[i] = ey + wide * s
        h = (c * (ax - cu) + s * (ay - cv)) / focal
        wide = ra * grown * math.sqrt(1.0 + h * h)
        px[edges + 1 + i] = ax - wide * c
        py[edges + 1 + i] = ay - wide * s
    return 2 * (edges + 1)


@compiled
def _ball(
    x: float,
    y: float,
    z: float,
    radius: float,
    camera: NDArray[np.float64],
    px: NDArray[np.float64],
    py: NDArray[np.float64],
) -> int:
    """Corners of a ball at (x, y, z) from the eye: the circle where sight lines touch it, projected."""
    distance = math.sqrt(x * x + y * y + z * z)
    nearer = 1.0 - radius * radius / (distance * distance)
    grown = radius * math.sqrt(nearer) / math.sqrt(math.sin(2 * math.pi / _BALL) / (2 * math.pi / _BALL))
    flat = math.sqrt(x * x + z * z)
    ax, az = z / flat, -x / flat  # across the line of sight, level
    bx, by, bz = -x * y / (flat * distance), flat / distance, -z * y / (flat * distance)
    for i in range(_BALL):
        c = grown * math.cos(2 * math.pi * i / _BALL)
        s = grown * math.sin(2 * math.pi * i / _BALL)
        depth = z * nearer + c * az + s * bz
        px[i] = camera[0] * (x * nearer + c * ax + s * bx) / depth + camera[1]
        py[i] = camera[0] * (y * nearer + s * by) / depth + camera[2]
    return _BALL


@compiled
def _hull(
    bx: NDArray[np.float64], by: NDArray[np.float64], px: NDArray[np.float64], py: NDArray[np.float64]
) -> int:
    """The convex hull of the points (bx, by), by monotone chains; returns how many corners it wrote."""
    n = bx.size
    for i in range(1, n):  # a few points: insertion sort
        x, y = bx[i], by[i]
        j = i - 1
        while j >= 0 and (bx[j] > x or (bx[j] == x and by[j] > y)):
            bx[j + 1], by[j + 1] = bx[j], by[j]
            j -= 1
        bx[j + 1], by[j + 1] = x, y
    k = 0
    for turn in range(2):
        start = k
        for m in range(n):
            i = m if turn == 0 else n - 1 - m
            while k >= start + 2 and (px[k - 1] - px[k - 2]) * (by[i] - py[k - 2]) <= (
                py[k - 1] - py[k - 2]
            ) * (bx[i] - px[k - 2]):
                k -= 1
            px[k], py[k] = bx[i], by[i]
            k += 1
        k -= 1  # the last point of a chain is the first of the other
    return k


@compiled
def _edge(
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    area: NDArray[np.float64],
    low: NDArray[np.int64],
    high: NDArray[np.int64],
) -> None:
    """Leave the signed area of one edge in ``area`` (height, width + 2)."""
    if abs(y1 - y0) < 1e-200:  # level, or so flat that its slope overflows
        return
    way = 1.0
    if y0 > y1:
        x0, y0, x1, y1, way = x1, y1, x0, y0, -1.0
    height, width = area.shape[0], area.shape[1] - 2
    if y1 <= 0.0 or y0 >= height:
        return
    slope = (x1 - x0) / (y1 - y0)
    if y0 < 0.0:
        x0 -= y0 * slope
        y0 = 0.0
    x = x0
    for v in range(int(y0), min(height, math.ceil(y1))):
        dy = min(v + 1.0, y1) - max(float(v), y0)
        beyond = x + slope * dy
        d = dy * way
        a = min(x, beyond)
        b = max(x, beyond)
        x = beyond
        if a < 0.0 or b > width:
            # What lies on the left of the image fills the row from its first pixel on, on the right it fills nothing.
            if b <= 0.0 or a >= width:
                u = 0 if b <= 0.0 else width
                area[v, u] += d
                low[v] = min(low[v], u)
                high[v] = max(high[v], u)
                continue
            share = d / (b - a)
            if a < 0.0:
                area[v, 0] -= share * a
                a = 0.0
            b = min(b, float(width))
            d = share * (b - a)
        first = int(a)
        last = math.ceil(b)
        if last <= first + 1:
            inside = d * (0.5 * (a + b) - first)
            area[v, first] += d - inside
            area[v, first + 1] += inside
        else:
            s = 1.0 / (b - a)
            left = 1.0 - (a - first)
            right = b - last + 1.0
            start = 0.5 * s * left * left
            end = 0.5 * s * right * right
            area[v, first] += d * start
            if last == first + 2:
                area[v, first + 1] += d * (1.0 - start - end)
            else:
                second = s * (left + 0.5)
                area[v, first + 1] += d * (second - start)
                for u in range(first + 2, last - 1):
                    area[v, u] += d * s
                third = second + (last - first - 3) * s
                area[v, last - 1] += d * (1.0 - third - end)
            area[v, last] += d * end
        low[v] = min(low[v], first)
        high[v] = max(high[v], max(last, first + 1))


@compiled
def add_outline(
    px: NDArray[np.float64],
    py: NDArray[np.float64],
    n: int,
    alpha: NDArray[np.float32],
    area: NDArray[np.float64],
    cover: NDArray[np.float64],
    rows: NDArray[np.int64],
    keep: bool,
) -> float:
    """Add a convex outline of ``n`` corners to ``cover`` (height, width): the greater coverage stays.

    Args:
        px: Columns of the corners.
        py: Rows of the corners.
        n: How many corners.
        alpha: (height, width) how dark the image is, 0 to 1; below 0 where that is unknown: such pixels cost nothing.
        area: (height, width + 2) of zeros, left as zeros.
        cover: (height, width) what is covered already.
        rows: (4, height) work space of row ends: the first two rows for this outline, the last two (least and greatest
            column touched so far) for all; see :func:`clear`.
        keep: Whether ``cover`` is changed; if not, only the cost of it is told.

    Returns:
        By how much the sum of (cover - alpha)^2 changed.
    """
    height, width = cover.shape
    low, high = rows[0], rows[1]
    top, bottom = py[0], py[0]
    for i in range(1, n):
        top = min(top, py[i])
        bottom = max(bottom, py[i])
    v0 = max(0, math.floor(top))
    v1 = min(height, math.ceil(bottom))
    for v in range(v0, v1):
        low[v], high[v] = width + 1, -1
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        _edge(px[i], py[i], px[j], py[j], area, low, high)
    change = 0.0
    for v in range(v0, v1):
        if high[v] < 0:
            continue
        total = 0.0
        for u in range(low[v], min(high[v] + 1, width)):
            total += area[v, u]
            area[v, u] = 0.0
            c = min(abs(total), 1.0)
            old = cover[v, u]
            if c > old:
                if keep:
                    cover[v, u] = c
                if alpha[v, u] >= 0.0:
                    change += (c - old) * (c + old - 2.0 * alpha[v, u])
        area[v, width] = 0.0
        area[v, width + 1] = 0.0
        if keep:
            rows[2, v] = min(rows[2, v], low[v])
            rows[3, v] = max(rows[3, v], min(high[v], width - 1))
    return change


@compiled
def clear(cover: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
    """Set ``cover`` back to zero where it was touched."""
    for v in range(cover.shape[0]):
        for u in range(rows[2, v], rows[3, v] + 1):
            cover[v, u] = 0.0
        rows[2, v] = cover.shape[1]
        rows[3, v] = -1
