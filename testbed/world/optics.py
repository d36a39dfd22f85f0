"""From a pinhole and a sensor to luminosities: the physical side of the stereo rig (Section 3.3, footnote 3)."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector

NEAR, FAR = 0.02, 20.0


def view_matrix(eye: Vector, target: Vector) -> tuple[float, ...]:
    """OpenGL view matrix of a camera at ``eye`` that looks at ``target``, world z up; 16 numbers by column."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    matrix = np.eye(4)
    matrix[:3, :3] = right, up, -forward
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return tuple(matrix.T.ravel().tolist())


def projection_matrix(horizontal_field: float, width: int, height: int) -> tuple[float, ...]:
    """OpenGL projection matrix for square pixels and a horizontal field of view in rad; 16 numbers by column."""
    scale = 1 / math.tan(horizontal_field / 2)
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = scale, scale * width / height
    matrix[2, 2], matrix[2, 3] = (FAR + NEAR) / (NEAR - FAR), 2 * FAR * NEAR / (NEAR - FAR)
    matrix[3, 2] = -1
    return tuple(matrix.T.ravel().tolist())


def luminosities(colours: NDArray[np.uint8], seen: NDArray[np.bool_], background: int) -> NDArray[np.float32]:
    """(H, W) a rendered picture of colours (H, W, 4) as luminosities, with the background where no body is seen."""
    luminosity = cv2.cvtColor(colours, cv2.COLOR_RGBA2GRAY).astype(np.float32)
    luminosity[~seen] = background
    return luminosity


def read_out(
    luminosity: NDArray[np.float32],
    *,
    shape: tuple[int, int],
    noise: float,
    rng: np.random.Generator,
    blur: float = 0.0,
    gain: float = 1.0,
) -> NDArray[np.uint8]:
    """What the sensor makes of a picture.

    The lens blurs, each pixel gathers the light of its whole area (the picture is finer than the sensor) for as long as
    it is exposed, then read-out noise is added.

    Args:
        luminosity: (H, W) of the picture.
        shape: Rows and columns of the sensor.
        noise: Standard deviation of the read-out noise, grey levels.
        rng: Source of the noise.
        blur: Standard deviation of a point's image, pixels of the sensor.
        gain: How many times as long it is exposed.

    Returns:
        Luminosities of ``shape``, uint8.
    """
    rows, columns = shape
    if blur:
        spread = blur * luminosity.shape[1] / columns
        blurred = cv2.GaussianBlur(luminosity, (0, 0), spread, borderType=cv2.BORDER_REPLICATE)
        luminosity = blurred.astype(np.float32, copy=False)
    gathered = cv2.resize(luminosity, (columns, rows), interpolation=cv2.INTER_AREA)
    if gain != 1.0:
        gathered = np.minimum(gathered * gain, 255.0)
    noisy = gathered + rng.normal(0.0, noise, gathered.shape)
    exposed: NDArray[np.uint8] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return exposed
