"""The kernel against a second, unrelated witness: the silhouettes that PyBullet's TinyRenderer draws.

Meshes and rays may share a misreading of the conventions with the kernel; here the bodies are Bullet's own,
placed in a z-up world by quaternions, and seen through OpenGL matrices.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pybullet
import pytest
from numpy.typing import NDArray
from pybullet_utils.bullet_client import BulletClient
from scipy.ndimage import maximum_filter, minimum_filter

from testbed.vision import CAPPED_CYLINDER, CUBOID, SPHERE, StereoRig, render

RIG = StereoRig(width=400, height=300)
Vector = tuple[float, ...]


@pytest.fixture(scope="module")
def client() -> Iterator[BulletClient]:
    bullet = BulletClient(pybullet.DIRECT)
    yield bullet
    bullet.disconnect()


def place(bullet: BulletClient, row: NDArray[np.float64]) -> list[int]:
    """Rig (x right, y down, z ahead) becomes world (x right, z up, y ahead); a roll turns about world y.

    A capped cylinder is a cylinder and two spheres: the caps of Bullet's own capsule are drawn too short.
    """
    half = row[4] / 2.0
    roll = (
        0.0,
        math.sin(half),
        0.0,
        math.cos(half),
    )  # takes the world's z towards x: clockwise for the student
    centre = (row[1], row[3], -row[2])

    def body(position: Vector, orientation: Vector, shape: int, **sizes: object) -> int:
        visual = bullet.createVisualShape(shape, **sizes)
        return int(bullet.createMultiBody(0, -1, visual, basePosition=position, baseOrientation=orientation))

    if row[0] == CUBOID:
        return [body(centre, roll, bullet.GEOM_BOX, halfExtents=(row[5] / 2.0, row[6] / 2.0, row[7] / 2.0))]
    if row[0] == SPHERE:
        return [body(centre, roll, bullet.GEOM_SPHERE, radius=row[5])]
    upright_to_x = bullet.getQuaternionFromEuler((0.0, math.pi / 2.0, 0.0))
    lying = bullet.multiplyTransforms((0, 0, 0), roll, (0, 0, 0), upright_to_x)[1]
    ends = [
        bullet.multiplyTransforms(centre, roll, (side * row[6] / 2.0, 0, 0), (0, 0, 0, 1))[0]
        for side in (-1, 1)
    ]
    bodies = [body(end, roll, bullet.GEOM_SPHERE, radius=row[5]) for end in ends]
    return [*bodies, body(centre, lying, bullet.GEOM_CYLINDER, radius=row[5], length=row[6])]


def silhouettes(bullet: BulletClient, parts: NDArray[np.float64]) -> NDArray[np.bool_]:
    bodies = [body for row in parts for body in place(bullet, row)]
    vertical = math.degrees(2.0 * math.atan(RIG.height / 2.0 / RIG.focal))
    projection = bullet.computeProjectionMatrixFOV(vertical, RIG.width / RIG.height, 0.01, 10.0)
    images = []
    for eye in RIG.eyes:
        view = bullet.computeViewMatrix((eye, 0.0, 0.0), (eye, 1.0, 0.0), (0.0, 0.0, 1.0))
        *_, segmentation = bullet.getCameraImage(
            RIG.width, RIG.height, view, projection, renderer=bullet.ER_TINY_RENDERER
        )
        images.append(np.reshape(segmentation, (RIG.height, RIG.width)) >= 0)
    for body in bodies:
        bullet.removeBody(body)
    return np.array(images)


@pytest.mark.parametrize("shape", [CUBOID, SPHERE, CAPPED_CYLINDER])
def test_agrees_with_the_silhouettes_of_bullet(client: BulletClient, shape: int) -> None:
    rng = np.random.default_rng(shape)
    for _ in range(8):
        z = rng.uniform(0.6, 1.5)
        sizes = rng.uniform(0.06, 0.3, 3) * (1.0 if shape == CUBOID else (0.5, 1.0, 1.0))
        x, y = z * rng.uniform(-0.3, 0.3), z * rng.uniform(-0.2, 0.2)
        parts = np.array([[shape, x, y, z, rng.uniform(-math.pi, math.pi), *sizes]])
        expected, seen = silhouettes(client, parts), render(parts, RIG) < 255
        # Bullet draws round bodies with few facets: the band of doubt is a facet's sagitta wide, 7 % of r.
        band = 3 if shape == CUBOID else 3 + 2 * math.ceil(0.07 * sizes[0] * RIG.focal / z)
        certain = maximum_filter(expected, (1, band, band)) == minimum_filter(expected, (1, band, band))
        assert expected[:, certain.all(axis=0)].any()
        assert np.array_equal(seen[certain], expected[certain])
