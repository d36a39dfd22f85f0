"""Bodies as Bullet has them: loaded, painted and seen; on the ground, on a pedestal or screwed to the spot."""

from __future__ import annotations

import contextlib
import functools
import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Mesh, Morphology, Vector
from testbed.bodies.parts import Texture
from testbed.bodies.urdf import to_urdf, write_urdf
from testbed.silence import silence

with silence():  # importing it prints its build time
    import pybullet

_FLOOR = (3.0, 3.0, 0.05)  # half sizes of a pedestal: nobody falls off its edge
_TEXELS = 128
_WHITE = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Body:
    """A body in a Bullet world.

    Attributes:
        number: Bullet's number for it.
        morphology: What it is.
        start: Position (m) and quaternion xyzw of its root where it was put.
        parts: Names of the parts in Bullet's order: the root, then its links.
        motors: Link number of every joint, in the morphology's order.
        torques: N m of every joint.
        speeds: rad/s of every joint.
        rest: Joint angles of a body that lies flat, rad.
        floor: Bullet's number for its pedestal; None on the ground.
    """

    number: int
    morphology: Morphology
    start: tuple[tuple[float, float, float], tuple[float, float, float, float]]
    parts: tuple[str, ...]
    motors: tuple[int, ...]
    torques: tuple[float, ...]
    speeds: tuple[float, ...]
    rest: Vector
    floor: int | None


def load_body(
    client: int,
    morphology: Morphology,
    *,
    place: tuple[float, float],
    yaw: float,
    height: float,
    fixed: bool,
    ground_friction: float,
) -> Body:
    """A body in the world of a client; see :meth:`testbed.physics.Simulation.add`."""
    position = (*place, height + morphology.resting_height())
    orientation = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    with _written(morphology) as file:
        number = pybullet.loadURDF(
            file,
            position,
            orientation,
            useFixedBase=fixed,
            flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
    info = [
        pybullet.getJointInfo(number, link, physicsClientId=client)
        for link in range(pybullet.getNumJoints(number, physicsClientId=client))
    ]
    links = {joint[1].decode(): joint[0] for joint in info}
    joints = morphology.joints
    # Bullet gives a body's root the frame of its centre of mass; the rest is named by the child part.
    parts = (morphology.root, *(joint[12].decode() for joint in info))
    for link, name in enumerate(parts, start=-1):
        texture = morphology.parts[name].texture
        if texture is not None:
            _paint(client, number, link, texture, morphology.parts[name].luminosity)
    return Body(
        number=number,
        morphology=morphology,
        start=(position, orientation),
        parts=parts,
        motors=tuple(links[joint] for joint in joints),
        torques=tuple(joint.torque for joint in joints.values()),
        speeds=tuple(math.radians(joint.speed_deg) for joint in joints.values()),
        rest=morphology.rest,
        floor=_floor(client, number, place, height, ground_friction) if height and not fixed else None,
    )


@contextlib.contextmanager
def _written(morphology: Morphology) -> Iterator[str]:
    """A URDF file for as long as it is read; a folder, which takes ten times as long, only where there are meshes."""
    if any(isinstance(part, Mesh) for part in morphology.parts.values()):
        with tempfile.TemporaryDirectory(prefix="testbed-") as folder:
            yield str(write_urdf(morphology, Path(folder)))
        return
    with tempfile.NamedTemporaryFile("w", prefix="testbed-", suffix=".urdf", encoding="utf-8") as file:
        file.write(to_urdf(morphology))
        file.flush()
        yield file.name


def unload(client: int, body: Body) -> None:
    """Take a body and its pedestal out of the world."""
    for number in (body.number, body.floor):
        if number is not None:
            pybullet.removeBody(number, physicsClientId=client)


def unseen(client: int) -> int:
    """The looks of what nobody is to see.

    Left to itself Bullet draws a chequered plane, which makes its renderer twenty times slower. The student's
    background is plain, so the ground's looks are a speck far below it.
    """
    return int(
        pybullet.createVisualShape(
            pybullet.GEOM_SPHERE, radius=1e-6, visualFramePosition=(0, 0, -1000), physicsClientId=client
        )
    )


def picture(
    client: int,
    view: tuple[float, ...],
    projection: tuple[float, ...],
    *,
    width: int,
    height: int,
    light: Mapping[str, object],
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """What a pinhole camera sees, by Bullet's software renderer.

    Args:
        client: Bullet's number for the world.
        view: OpenGL view matrix, 16 numbers column by column.
        projection: OpenGL projection matrix, likewise.
        width: Pixels across.
        height: Pixels down.
        light: Keyword arguments of ``pybullet.getCameraImage`` about lighting.

    Returns:
        Colours (height, width, 4), of which the last number means nothing, and where a body is seen (height, width).
    """
    _, _, colours, _, bodies = pybullet.getCameraImage(
        width,
        height,
        view,
        projection,
        renderer=pybullet.ER_TINY_RENDERER,
        physicsClientId=client,
        **light,
    )
    rgba = np.asarray(colours, dtype=np.uint8).reshape(height, width, 4)
    return rgba, np.asarray(bodies).reshape(height, width) >= 0


def _floor(client: int, number: int, place: tuple[float, float], height: float, friction: float) -> int:
    """A floor at a height that carries this body alone, so that pedestals may overlap."""
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=_FLOOR, physicsClientId=client)
    middle = (*place, height - _FLOOR[2])
    floor = int(pybullet.createMultiBody(0, shape, unseen(client), middle, physicsClientId=client))
    pybullet.changeDynamics(floor, -1, lateralFriction=friction, physicsClientId=client)
    pybullet.setCollisionFilterGroupMask(floor, -1, 0, 0, physicsClientId=client)
    for link in range(-1, pybullet.getNumJoints(number, physicsClientId=client)):
        pybullet.setCollisionFilterPair(floor, number, -1, link, 1, physicsClientId=client)
    return floor


def _paint(client: int, number: int, link: int, texture: Texture, grey: int) -> None:
    with tempfile.TemporaryDirectory(prefix="testbed-") as folder:
        file = Path(folder) / "texture.png"
        file.write_bytes(_picture(texture, grey))
        known = pybullet.loadTexture(str(file), physicsClientId=client)
    pybullet.changeVisualShape(number, link, textureUniqueId=known, rgbaColor=_WHITE, physicsClientId=client)


@functools.lru_cache(maxsize=64)
def _picture(texture: Texture, grey: int) -> bytes:
    """The pattern as a PNG file."""
    levels = np.clip(np.rint(grey * (1 + texture.contrast * pattern(texture))), 0, 255).astype(np.uint8)
    return bytes(cv2.imencode(".png", np.repeat(levels[..., None], 3, axis=2))[1])


def pattern(texture: Texture) -> NDArray[np.float64]:
    """(128, 128) how much brighter (1) or darker (-1) a pattern is."""
    count = texture.patches
    along = np.arange(_TEXELS) * count // _TEXELS
    if texture.pattern == "stripes":
        return np.tile(np.where(along % 2 == 0, 1.0, -1.0), (_TEXELS, 1))
    if texture.pattern == "checks":
        return np.where((along[:, None] + along) % 2 == 0, 1.0, -1.0)
    patches = np.random.default_rng(texture.seed).uniform(-1.0, 1.0, (count, count))
    return patches[along[:, None], along]
