"""What there is to be seen on an emulated bench: the robots in their world, or somebody holding the calibration board.

A scene gives snapshots, cheap to take, which a camera looks at later, if ever. Everything is told in the rig frame: x
right, y down, z ahead, origin between the eyes. Luminosities are those of the world, 255 for a white surface in full
light; what a lens and a sensor make of them is the camera's business.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.hardware.calibration.charuco import TEXELS, CharucoSpec
from testbed.hardware.emulation.lens import SIZE, Lens, Mount
from testbed.physics import Simulation
from testbed.scenario.specs import LightSpec, RigSpec
from testbed.vision._jit import compiled
from testbed.vision.shading import cast
from testbed.world.analytic import solids_of, undrawable
from testbed.world.optics import FAR, luminosities, view_matrix

Picture = NDArray[np.float32]
Shot = Callable[[Lens, Mount], Picture]
"""(480, 640) luminosities that a camera with this lens in this place sees."""

_KEPT_PICTURES = 2  # of a board: one an eye
_MARGIN = 1.02  # of the ideal picture that a bent one is cut from


class Scene(Protocol):
    """Something to look at."""

    def snapshot(self) -> Shot:
        """What there is now, to be looked at now or later."""
        ...


class BoardScene:
    """The calibration board before a plain wall, held by somebody.

    Args:
        spec: What is printed on it.
        pose: (4, 4) of the board frame in the rig frame: a point of the board becomes one of the rig.
        wall: Grey level of all that is not the board.
        supersample: Rays through each pixel, along each side.
    """

    def __init__(self, spec: CharucoSpec, pose: Vector, *, wall: float = 150.0, supersample: int = 4) -> None:
        self.spec, self.pose = spec, pose
        self._wall, self._supersample = wall, supersample
        paper = np.full((spec.rows * TEXELS + 2 * TEXELS, spec.columns * TEXELS + 2 * TEXELS), 235, np.uint8)
        # Ink is not black and paper not white.
        printed = np.where(spec.texels() > 0, np.uint8(235), np.uint8(25))
        paper[TEXELS:-TEXELS, TEXELS:-TEXELS] = printed  # a white margin of one square, as on the sheet
        self._paper = paper
        self._seen: dict[tuple[Lens, Mount, bytes], Picture] = {}

    def snapshot(self) -> Shot:
        """See :class:`Scene`; a board that is held still is the same picture to a camera again and again."""
        paper, pose, texel = self._paper, self.pose.copy(), self.spec.square / TEXELS
        wall, supersample, kept = self._wall, self._supersample, self._seen

        def seen(lens: Lens, mount: Mount) -> Picture:
            asked = (lens, mount, pose.tobytes())
            if (before := kept.get(asked)) is not None:
                return before.copy()
            # A ray e + t d meets the board where its third coordinate in the board frame is nought.
            turn = pose[:3, :3].T
            eye = turn @ (np.array(mount.place) - pose[:3, 3])
            out = np.empty((SIZE[1], SIZE[0]), np.float32)
            axes = np.ascontiguousarray(turn @ mount.axes())
            _cast_board(paper, TEXELS, texel, eye, axes, lens.corner_rays(), supersample, wall, out)
            if len(kept) >= _KEPT_PICTURES:
                kept.clear()
            kept[asked] = out.copy()
            return out

        return seen


@compiled
def _cast_board(
    paper: NDArray[np.uint8],
    rim: int,
    texel: float,
    eye: NDArray[np.float64],
    axes: NDArray[np.float64],
    rays: NDArray[np.float64],
    supersample: int,
    wall: float,
    out: NDArray[np.float32],
) -> None:
    """Mean luminosity of some rays through each pixel; ``axes`` (3, 3) are columns in the board frame."""
    height, width = out.shape
    for row in range(height):
        for column in range(width):
            total = 0.0
            for i in range(supersample):
                for j in range(supersample):
                    # No two rays of a pixel in one row or column: edges along the pixels are as smooth as others.
                    a = (j + (i + 0.5) / supersample) / supersample
                    b = (i + (j + 0.5) / supersample) / supersample
                    # Within a pixel the rays' slopes are as good as linear.
                    x = (1 - b) * ((1 - a) * rays[row, column, 0] + a * rays[row, column + 1, 0])
                    x += b * ((1 - a) * rays[row + 1, column, 0] + a * rays[row + 1, column + 1, 0])
                    y = (1 - b) * ((1 - a) * rays[row, column, 1] + a * rays[row, column + 1, 1])
                    y += b * ((1 - a) * rays[row + 1, column, 1] + a * rays[row + 1, column + 1, 1])
                    way = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2]
                    t = -eye[2] / way if way != 0.0 else -1.0
                    grey = wall
                    if t > 0.0:
                        u = (eye[0] + t * (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2])) / texel + rim
                        v = (eye[1] + t * (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2])) / texel + rim
                        if 0.0 <= u < paper.shape[1] and 0.0 <= v < paper.shape[0]:
                            grey = float(paper[int(v), int(u)])
                    total += grey
            out[row, column] = total / (supersample * supersample)


class RobotScene:
    """The bodies of a simulation, before a plain light backdrop, seen from a rig on its post at the world's origin.

    Bodies are drawn by exact ray casting; where one has a mesh or a texture all are drawn by Bullet's renderer, at the
    time when somebody looks, for it knows no snapshots.

    Args:
        simulation: Whose bodies.
        rig: Height of the post, the light and the backdrop's grey.
        pan: Where the rig looks now, rad, positive to the right.
    """

    def __init__(self, simulation: Simulation, rig: RigSpec, pan: Callable[[], float]) -> None:
        self._simulation, self._rig, self._pan = simulation, rig, pan

    def snapshot(self) -> Shot:
        """See :class:`Scene`."""
        bodies, pan = self._simulation.bodies, self._pan()
        if any(undrawable(body) for body in bodies.values()):
            return functools.partial(_by_bullet, self._simulation, self._rig, pan)
        solids, poses = [np.zeros((0, 5))], [np.zeros((0, 7))]
        for name, body in bodies.items():
            solids.append(solids_of(body))
            poses.append(self._simulation.frames(name))
        return functools.partial(_by_rays, np.concatenate(solids), np.concatenate(poses), self._rig, pan)


def _by_rays(solids: Vector, poses: Vector, rig: RigSpec, pan: float, lens: Lens, mount: Mount) -> Picture:
    straight = _straight(lens)
    turned, eye = _in_the_world(rig, pan, mount)
    direction = np.array(rig.light.direction) / math.hypot(*rig.light.direction)
    shares = np.array([rig.light.ambient, rig.light.diffuse, rig.light.specular])
    depth = np.full(straight.shape, np.inf, np.float32)
    picture = np.full(straight.shape, rig.background, np.float32)
    # The caster's y axis points up.
    right, down, ahead = turned.T
    axes = np.stack([right, -down, ahead])
    cast(solids, poses, axes, eye, straight.slopes, direction, shares, depth, picture)
    return straight.bent(picture)


def _by_bullet(simulation: Simulation, rig: RigSpec, pan: float, lens: Lens, mount: Mount) -> Picture:
    straight = _straight(lens)
    turned, eye = _in_the_world(rig, pan, mount)
    height, width = straight.shape
    near = 0.02
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = 1 / straight.slopes[0], 1 / straight.slopes[1]
    matrix[2, 2], matrix[2, 3] = (FAR + near) / (near - FAR), 2 * FAR * near / (near - FAR)
    matrix[3, 2] = -1
    right, down, ahead = turned.T
    view = np.array(view_matrix(eye, eye + ahead)).reshape(4, 4).T
    view[:3, :3] = right, -down, -ahead
    view[:3, 3] = -view[:3, :3] @ eye
    drawn = simulation.picture(
        tuple(view.T.ravel().tolist()),
        tuple(matrix.T.ravel().tolist()),
        width=width,
        height=height,
        light=_bullets_light(rig.light),
    )
    return straight.bent(luminosities(*drawn, rig.background), shift=0.5)


def _bullets_light(light: LightSpec) -> dict[str, object]:
    return {
        "lightDirection": light.direction,
        "lightAmbientCoeff": light.ambient,
        "lightDiffuseCoeff": light.diffuse,
        "lightSpecularCoeff": light.specular,
        "shadow": 0,
    }


def _in_the_world(rig: RigSpec, pan: float, mount: Mount) -> tuple[Vector, Vector]:
    """The camera's axes (3, 3; right, down, ahead as columns) and its eye (3,) in the world."""
    sine, cosine = math.sin(pan), math.cos(pan)
    frame = np.array(
        [[cosine, 0.0, sine], [-sine, 0.0, cosine], [0.0, -1.0, 0.0]]
    )  # the rig's axes as columns
    return frame @ mount.axes(), np.array([0.0, 0.0, rig.height]) + frame @ np.array(mount.place)


class _Straight:
    """An ideal picture somewhat larger than what a lens shows, and where in it each pixel of the lens looks."""

    def __init__(self, lens: Lens) -> None:
        rays = lens.pixel_rays()
        across, down = np.abs(rays[..., 0]).max() * _MARGIN, np.abs(rays[..., 1]).max() * _MARGIN
        self.slopes = np.array([across, down])
        self.shape = (math.ceil(2 * down * lens.focal[1]), math.ceil(2 * across * lens.focal[0]))
        self._u = ((rays[..., 0] / across + 1) * self.shape[1] / 2 - 0.5).astype(np.float32)
        self._v = ((rays[..., 1] / down + 1) * self.shape[0] / 2 - 0.5).astype(np.float32)

    def bent(self, picture: Picture, shift: float = 0.0) -> Picture:
        """The ideal picture as the lens shows it; ``shift``: how far right and up of its place it is drawn, pixels."""
        u, v = (self._u + np.float32(shift), self._v - np.float32(shift)) if shift else (self._u, self._v)
        return np.asarray(
            cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32
        )


@functools.lru_cache(maxsize=4)
def _straight(lens: Lens) -> _Straight:
    return _Straight(lens)
