"""What is looked at: many models, all different, as a search meets them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.vision import CUBOID, StereoRig

RIG = StereoRig()
MODELS = 64


def models(parts: int, count: int = MODELS, seed: int = 0) -> NDArray[np.float64]:
    """(count, parts, 8) models before the camera at social distance: a box and limbs, drawn anew."""
    rng = np.random.default_rng(seed)
    made = np.empty((count, parts, 8))
    made[..., 0] = np.where((np.arange(parts) == 0) & (parts > 1), CUBOID, rng.integers(0, 3, (count, parts)))
    made[..., 1] = rng.uniform(-0.25, 0.25, (count, parts))
    made[..., 2] = rng.uniform(-0.2, 0.2, (count, parts))
    made[..., 3] = rng.uniform(0.7, 1.1, (count, parts))
    made[..., 4] = rng.uniform(-math.pi / 2, math.pi / 2, (count, parts))
    made[..., 5:] = rng.uniform(0.04, 0.2, (count, parts, 3))
    made[..., 5] *= np.where(made[..., 0] == CUBOID, 1.0, 0.5)  # elsewhere it is a radius
    return made


def pixels(count: int) -> NDArray[np.int64]:
    """(count,) of the image's pixels in a random order, all of them if there are so many."""
    return np.random.default_rng(1).permutation(RIG.width * RIG.height)[:count]


def rays(chosen: NDArray[np.int64]) -> NDArray[np.float64]:
    """(K, 2) of these pixels."""
    return np.ascontiguousarray(RIG.rays().reshape(-1, 2)[chosen])
