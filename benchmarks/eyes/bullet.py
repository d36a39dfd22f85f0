"""PyBullet's two ways to see: its software renderer and its ray tests. A body's size cannot be changed in place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import Look, Model, Rays, shades
from testbed.silence import silence
from testbed.vision import CAPPED_CYLINDER, CUBOID, StereoRig

with silence():
    import pybullet


def connect() -> int:
    """A world without a window, for as long as the process lives."""
    return int(pybullet.connect(pybullet.DIRECT))


def open_renderer(eye: float, pixels: NDArray[np.int64], rig: StereoRig) -> Look:
    """TinyRenderer draws the whole image of the rig, of which the pixels are read; all bodies are made anew."""
    client = connect()

    def look(model: Model) -> NDArray[np.uint8]:
        build(client, model, collide=False)
        return shades(drawn(client, eye, rig)[pixels])

    return look


def drawn(client: int, eye: float, rig: StereoRig) -> NDArray[np.bool_]:
    """(pixels,): where TinyRenderer sees a body, rows joined."""
    vertical = np.degrees(2.0 * np.arctan(rig.height / 2.0 / rig.focal))
    projection = pybullet.computeProjectionMatrixFOV(vertical, rig.width / rig.height, 0.01, 10.0)
    view = pybullet.computeViewMatrix((eye, 0, 0), (eye, 1, 0), (0, 0, 1))
    renderer = pybullet.ER_TINY_RENDERER
    image = pybullet.getCameraImage(
        rig.width, rig.height, view, projection, renderer=renderer, physicsClientId=client
    )
    return np.asarray(np.ravel(image[4]) >= 0)


def open_rays(rays: Rays, eye: float) -> Look:
    """rayTestBatch against bodies that are made anew."""
    client = connect()
    start = np.tile([eye, 0.0, 0.0], (len(rays), 1))
    ahead = np.column_stack([rays[:, 0], np.ones(len(rays)), -rays[:, 1]])
    starts, ends = start.tolist(), (start + 5.0 * ahead).tolist()

    def look(model: Model) -> NDArray[np.uint8]:
        build(client, model, collide=True)
        return shades(
            np.array([hit[0] >= 0 for hit in pybullet.rayTestBatch(starts, ends, physicsClientId=client)])
        )

    return look


def build(client: int, model: Model, *, collide: bool) -> None:
    """The parts as bodies, in Bullet's axes: x right, y ahead, z up."""
    pybullet.resetSimulation(physicsClientId=client)
    for shape, x, y, z, omega, d1, d2, d3 in model:
        kind: dict[str, object] = {"shapeType": pybullet.GEOM_SPHERE, "radius": d1}
        turn = pybullet.getQuaternionFromEuler((0.0, omega, 0.0))
        if shape == CUBOID:
            kind = {"shapeType": pybullet.GEOM_BOX, "halfExtents": (d1 / 2, d2 / 2, d3 / 2)}
        elif shape == CAPPED_CYLINDER:
            kind = {"shapeType": pybullet.GEOM_CAPSULE, "radius": d1, "height" if collide else "length": d2}
            turn = pybullet.getQuaternionFromEuler((0.0, omega + np.pi / 2.0, 0.0))
        collision = pybullet.createCollisionShape(**kind, physicsClientId=client) if collide else -1
        visual = -1 if collide else pybullet.createVisualShape(**kind, physicsClientId=client)
        pybullet.createMultiBody(0, collision, visual, (x, z, -y), turn, physicsClientId=client)
