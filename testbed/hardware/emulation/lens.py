"""A lens that bends straight lines, and where its camera really sits: what calibration has to find out.

The distortion is the one that OpenCV fits (Brown and Conrady: k1, k2, p1, p2, k3), but the mathematics is written here
a second time and in the other direction, from pixels to rays, so that a mistake in the use of either shows.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.frames import rotation_about

SIZE = (640, 480)
"""Width and height of the sensor in pixels."""
_ROUNDS = 14


@dataclass(frozen=True)
class Lens:
    """From rays to pixels. Whole numbers are pixel centres.

    Attributes:
        focal: Focal lengths across and down, pixels; by default 60 degrees wide, as common webcams are.
        centre: Where the optical axis meets the sensor, (u, v).
        distortion: k1, k2, p1, p2, k3.
    """

    focal: tuple[float, float] = (555.0, 555.0)
    centre: tuple[float, float] = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def bend(self, rays: Vector) -> Vector:
        """(..., 2) slopes (x / z, y / z) of rays as the lens bends them."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = rays[..., 0], rays[..., 1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        bent_x = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
        bent_y = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return np.asarray(np.stack([bent_x, bent_y], axis=-1))

    def project(self, points: Vector) -> Vector:
        """Where points (..., 3) of the camera frame (x right, y down, z ahead) appear, (..., 2) pixels."""
        bent = self.bend(points[..., :2] / points[..., 2:])
        u = bent[..., 0] * self.focal[0] + self.centre[0]
        v = bent[..., 1] * self.focal[1] + self.centre[1]
        return np.asarray(np.stack([u, v], axis=-1))

    def rays(self, pixels: Vector) -> Vector:
        """Slopes (..., 2) of the rays that end in these pixels (..., 2); by repeated correction."""
        bent = (np.asarray(pixels, dtype=np.float64) - self.centre) / np.asarray(self.focal)
        rays = bent.copy()
        for _ in range(_ROUNDS):
            rays += bent - self.bend(rays)
        return np.asarray(rays)

    def corner_rays(self) -> NDArray[np.float64]:
        """(height + 1, width + 1, 2) slopes of the rays that end in the pixels' corners."""
        return _corner_rays(self)

    def pixel_rays(self) -> NDArray[np.float64]:
        """(height, width, 2) slopes of the rays that end in the pixels' centres."""
        return _pixel_rays(self)


@functools.lru_cache(maxsize=4)
def _corner_rays(lens: Lens) -> NDArray[np.float64]:
    columns, rows = np.meshgrid(np.arange(SIZE[0] + 1) - 0.5, np.arange(SIZE[1] + 1) - 0.5)
    return lens.rays(np.stack([columns, rows], axis=-1))


@functools.lru_cache(maxsize=4)
def _pixel_rays(lens: Lens) -> NDArray[np.float64]:
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    return lens.rays(np.stack([columns, rows], axis=-1))


@dataclass(frozen=True)
class Mount:
    """Where a camera sits on the rig, beside where it should.

    Attributes:
        place: (x, y, z) of its eye in the rig frame (x right, y down, z ahead, origin between the eyes), m.
        turn: Rotation vector (rad) from the rig's axes to the camera's.
    """

    place: tuple[float, float, float]
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def axes(self) -> Vector:
        """(3, 3) the camera's x, y and z axes in the rig frame, as columns."""
        return rotation_about(self.turn)[:3, :3]

    def moved(self, turn: tuple[float, float, float]) -> Mount:
        """The same camera knocked: turned by a further rotation vector (rad) in its own frame."""
        both = self.axes() @ rotation_about(turn)[:3, :3]
        return Mount(self.place, _vector(both))


def _vector(rotation: Vector) -> tuple[float, float, float]:
    """The rotation vector (rad) of a (3, 3) rotation by less than half a turn."""
    across = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = float(np.linalg.norm(across)) / 2
    angle = float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))
    x, y, z = (across / 2 * (angle / sine if sine > 0 else 1.0)).tolist()
    return x, y, z


@dataclass(frozen=True)
class Sensor:
    """What happens to the light behind the lens.

    Attributes:
        exposure: Grey level of what is white, as a share of 255: room for brighter frames, as one would set it.
        vignetting: How much darker the picture's corners are than its middle.
        blur: Standard deviation of a point's image, pixels: an ordinary webcam in focus.
        noise: Standard deviation of the read-out noise, grey levels.
    """

    exposure: float = 0.8
    vignetting: float = 0.25
    blur: float = 0.7
    noise: float = 2.0


@dataclass(frozen=True)
class RigTruth:
    """A pair of cameras as somebody built it.

    Attributes:
        lenses: Left and right.
        mounts: Left and right.
        sensor: The same for both.
    """

    lenses: tuple[Lens, Lens] = (Lens(), Lens())
    mounts: tuple[Mount, Mount] = (Mount((-0.05, 0.0, 0.0)), Mount((0.05, 0.0, 0.0)))
    sensor: Sensor = field(default_factory=Sensor)

    @property
    def baseline(self) -> float:
        """The distance between the eyes, m."""
        left, right = (np.array(mount.place) for mount in self.mounts)
        return float(np.linalg.norm(right - left))


def built_rig(rng: np.random.Generator, baseline: float = 0.1, sensor: Sensor | None = None) -> RigTruth:
    """A rig as bought and screwed together: no two lenses alike, no camera quite where and how it should be.

    Focal lengths within 2%, optical axes within 8 pixels of the middle, distortion of ordinary webcams (some -10
    pixels in the corners), eyes within a third of a millimetre and axes within half a degree of what is wanted.
    """
    lenses, mounts = [], []
    for side in (-0.5, 0.5):
        focal = 555.0 * rng.uniform(0.98, 1.02)
        lenses.append(
            Lens(
                (focal, focal * rng.uniform(0.998, 1.002)),
                ((SIZE[0] - 1) / 2 + rng.uniform(-8, 8), (SIZE[1] - 1) / 2 + rng.uniform(-8, 8)),
                (
                    rng.uniform(-0.14, -0.06),
                    rng.uniform(0.02, 0.06),
                    rng.uniform(-1e-3, 1e-3),
                    rng.uniform(-1e-3, 1e-3),
                    rng.uniform(-0.01, 0.01),
                ),
            )
        )
        x, y, z = (rng.uniform(-0.3e-3, 0.3e-3, 3) + np.array([side * baseline, 0, 0])).tolist()
        a, b, c = np.radians(rng.uniform(-0.5, 0.5, 3)).tolist()
        mounts.append(Mount((x, y, z), (a, b, c)))
    return RigTruth((lenses[0], lenses[1]), (mounts[0], mounts[1]), sensor or Sensor())
