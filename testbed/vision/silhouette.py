"""What silhouettes look like: how dark each pixel of an image is, and how much of it a model covers.

A limb is about two pixels thick in the student's eyes, so a pixel's grey carries the place of an edge within the
pixel. Nothing is made black or white here: darkness goes from 0 (background) to 1 (fully covered).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.student.parameters import SilhouetteParameters
from testbed.vision._spans import CORNERS, add_outline, outline
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import D1, OMEGA, SHAPE, X, Z, as_parts


def darkness(images: NDArray[np.uint8], parameters: SilhouetteParameters) -> NDArray[np.float32]:
    """How much of each pixel is covered, 0 to 1, seen against the shade of its neighbourhood.

    The background is the median luminosity, since a candidate fills less than half of what is seen. Sides of a part
    that face the light are brighter than others, so one level of full darkness for all would make them look half
    empty: the darkest of the 3 x 3 neighbours tells the shade.

    Args:
        images: (..., height, width) luminosity of one candidate before a light background.
        parameters: Levels.

    Returns:
        Same shape, float32.
    """
    background = np.float32(np.median(images))
    dark = np.clip(background - images.astype(np.float32), 0, None)
    # A sensor that clips at white hides one half of the noise; the other half has its standard deviation here.
    noise = max(float(np.quantile(dark, 0.84)), 1.0)
    dark[dark < parameters.faint * noise] = 0
    solid = dark[dark > 0.5 * dark.max(initial=0.0)]
    if solid.size == 0:
        return np.zeros_like(dark)
    darkest = float(np.quantile(solid, parameters.dark_quantile))
    flat = dark.reshape(-1, *images.shape[-2:])
    shade = np.stack([cv2.dilate(image, np.ones((3, 3), np.uint8)) for image in flat]).reshape(dark.shape)
    full = np.clip(shade, parameters.brightest_share * darkest, darkest)
    share: NDArray[np.float32] = np.minimum(dark / full, 1).astype(np.float32)
    return share


def camera_of(rig: StereoRig) -> NDArray[np.float64]:
    """Focal length and the image's middle in pixels, (3,), as the compiled renderer takes them."""
    return np.array([rig.focal, rig.width / 2, rig.height / 2])


def coverage(parts: NDArray[np.float64], rig: StereoRig) -> NDArray[np.float64]:
    """How much of each pixel a model covers: (2, height, width) from 0 to 1, left then right.

    ``parts`` (k, 8) is a model of Eq. 2 (m, rad, rig frame). Unlike :func:`testbed.vision.kernel.render`, which asks
    for a pixel's middle, this is the share of the pixel's area, exact also where an outline leaves
    the image.

    Raises:
        ValueError: If ``parts`` is no model.
    """
    parts = as_parts(parts)
    blank = np.zeros((rig.height, rig.width), np.float32)
    area = np.zeros((rig.height, rig.width + 2))
    px, py, camera = np.empty(CORNERS), np.empty(CORNERS), camera_of(rig)
    out = np.zeros((2, rig.height, rig.width))
    rows = np.zeros((4, rig.height), np.int64)
    for eye, cover in zip(rig.eyes, out, strict=True):
        for part in parts:
            c, s = np.cos(part[OMEGA]), np.sin(part[OMEGA])
            axes = np.array([[c, s, 0.0], [0.0, 0.0, 1.0], [s, -c, 0.0]])
            size = part[D1:].copy()
            corners = outline(int(part[SHAPE]), part[X : Z + 1], axes, size, eye, camera, px, py)
            if corners:
                add_outline(px, py, corners, blank, area, cover, rows, True)
    return out
