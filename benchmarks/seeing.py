"""How fast does the student see? The pixel kernel and the modelling loop against their peers.

Ours and a peer's turns alternate, so that a neighbour's load falls on both; the ratio is peer time / our time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pybullet
from numpy.typing import NDArray
from pybullet_utils.bullet_client import BulletClient

from benchmarks.measure import Row, against, row
from testbed.student.parameters import TeacherModellingParameters
from testbed.student.seeing.teacher_modelling import Modelling
from testbed.vision import CAPPED_CYLINDER, CUBOID, SPHERE, StereoRig, render
from testbed.vision.kernel import cover

RIG = StereoRig()
PARTS = np.array(
    [
        [CUBOID, -0.1, 0.1, 0.9, 0.3, 0.14, 0.11, 0.05],
        [CAPPED_CYLINDER, 0.1, 0.06, 0.9, -0.4, 0.01, 0.2, 0.0],
        [SPHERE, 0.2, 0.0, 0.9, 0.0, 0.05, 0.0, 0.0],
    ]
)
PIXELS = 1000


def rows() -> list[Row]:
    """Every measurement of this file, as rows of benchmarks/results.json."""
    pixels = np.random.default_rng(0).permutation(RIG.width * RIG.height)[:PIXELS]
    rays = RIG.rays().reshape(-1, 2)[pixels]
    ours = kernel(rays.astype(np.float32))
    bullet = BulletClient(pybullet.DIRECT)
    try:
        peers = [
            ("NumPy, vectorised", 10.0, 20, partial(with_numpy, rays)),
            ("PyBullet rayTestBatch, bodies rebuilt", 100.0, 1, partial(with_rays, bullet, rays)),
            ("PyBullet TinyRenderer, bodies rebuilt", 100.0, 1, partial(with_renderer, bullet)),
        ]
        compared = [
            against(f"{PIXELS} pixels of 3 parts", name, target, ours, peer, turns=turns)
            for name, target, turns, peer in peers
        ]
    finally:
        bullet.disconnect()
    return [*compared, whole_run()]


def kernel(rays: NDArray[np.float32]) -> Callable[[], object]:
    """The luminosities of the pixels for one model and one camera, as the modelling loop asks for them."""
    dx, dy = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
    row, dark = np.empty(len(rays), np.uint8), np.empty(len(rays), np.uint8)

    def see() -> NDArray[np.uint8]:
        dark[:] = 0
        for part in PARTS:
            cover(part, RIG.eyes[0], dx, dy, row)
            np.bitwise_or(dark, row, out=dark)
        return np.where(dark, 96, 255)

    return see


def with_numpy(rays: NDArray[np.float64]) -> NDArray[np.int64]:
    dark = np.zeros(len(rays), bool)
    x, y = rays.T
    for shape, px, py, z, omega, d1, d2, d3 in PARTS:
        c, s, cx = np.cos(omega), np.sin(omega), px - RIG.eyes[0]
        if shape == CUBOID:
            ox, oy, ax, ay = x * c + y * s, y * c - x * s, cx * c + py * s, py * c - cx * s
            with np.errstate(divide="ignore"):
                bounds = [((ax - d1 / 2) / ox, (ax + d1 / 2) / ox), ((ay - d3 / 2) / oy, (ay + d3 / 2) / oy)]
            enter = np.maximum.reduce(
                [np.minimum(*b) for b in bounds] + [np.full_like(x, max(z - d2 / 2, 0.0))]
            )
            leave = np.minimum.reduce([np.maximum(*b) for b in bounds] + [np.full_like(x, z + d2 / 2)])
            dark |= enter <= leave
        else:
            half = d2 / 2 if shape == CAPPED_CYLINDER else 0.0
            a = np.stack([y * z - py, cx - x * z, x * py - y * cx])
            b = np.stack([np.full_like(x, -s), np.full_like(x, c), x * s - y * c])
            along = np.clip(-(a * b).sum(0) / (b * b).sum(0), -half, half)
            dark |= ((a + along * b) ** 2).sum(0) <= d1 * d1 * (x * x + y * y + 1.0)
    return np.where(dark, 96, 255)


def build(bullet: BulletClient, *, collide: bool) -> None:
    """The parts as bodies: a mutation changes sizes, and a body's size cannot be changed in place."""
    bullet.resetSimulation()
    for shape, x, y, z, omega, d1, d2, d3 in PARTS:
        kind: dict[str, object] = {"shapeType": bullet.GEOM_SPHERE, "radius": d1}
        turn = bullet.getQuaternionFromEuler((0.0, omega, 0.0))
        if shape == CUBOID:
            kind = {"shapeType": bullet.GEOM_BOX, "halfExtents": (d1 / 2, d2 / 2, d3 / 2)}
        elif shape == CAPPED_CYLINDER:
            kind = {"shapeType": bullet.GEOM_CAPSULE, "radius": d1, "height" if collide else "length": d2}
            turn = bullet.getQuaternionFromEuler((0.0, omega + np.pi / 2.0, 0.0))
        collision = bullet.createCollisionShape(**kind) if collide else -1
        visual = -1 if collide else bullet.createVisualShape(**kind)
        bullet.createMultiBody(0, collision, visual, (x, z, -y), turn)


def with_rays(bullet: BulletClient, rays: NDArray[np.float64]) -> NDArray[np.int64]:
    build(bullet, collide=True)
    start = np.tile([RIG.eyes[0], 0.0, 0.0], (len(rays), 1))
    ahead = np.column_stack([rays[:, 0], np.ones(len(rays)), -rays[:, 1]])
    hits = bullet.rayTestBatch(start.tolist(), (start + 5.0 * ahead).tolist())
    return np.where([hit[0] >= 0 for hit in hits], 96, 255)


def with_renderer(bullet: BulletClient) -> NDArray[np.int64]:
    build(bullet, collide=False)
    vertical = np.degrees(2.0 * np.arctan(RIG.height / 2.0 / RIG.focal))
    projection = bullet.computeProjectionMatrixFOV(vertical, RIG.width / RIG.height, 0.01, 10.0)
    view = bullet.computeViewMatrix((RIG.eyes[0], 0, 0), (RIG.eyes[0], 1, 0), (0, 0, 1))
    image = bullet.getCameraImage(RIG.width, RIG.height, view, projection, renderer=bullet.ER_TINY_RENDERER)
    return np.where(np.ravel(image[4]) >= 0, 96, 255)


def whole_run() -> Row:
    """3000 passes of the estimation-exploration algorithm in seconds, against 1.5."""
    images = render(PARTS, RIG)
    seconds = []
    for seed in range(8):  # the first compiles, or loads what was compiled
        begin = time.perf_counter()
        modelling = Modelling(RIG, 3, TeacherModellingParameters(), np.random.default_rng(seed))
        for _ in range(3):
            modelling.observe(*images)
        seconds.append(time.perf_counter() - begin)
    ours = np.array(seconds[1:])
    name = "teacher modelling, 3000 passes"
    return row(name, "target seconds", 1.0, np.full_like(ours, 1.5), ours)
