"""Who else can say what K rays from one camera meet: each an ``open`` that gives a function model -> luminosities.

A model (k, 8) is as in :mod:`testbed.vision.primitives`; its poses, sizes and shapes change from call to call, so
whatever a library prepares for one scene it prepares anew.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from testbed.vision.kernel import PART_LUMINOSITY, WHITE

Model = NDArray[np.float64]  # (k, 8)
Rays = NDArray[np.float64]  # (K, 2): a ray goes along (x, y, 1)
Look = Callable[[Model], NDArray[np.uint8]]  # (K,)


class MissingError(Exception):
    """A peer that is not on this machine; the message says what it lacks."""


def shades(dark: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(K,) luminosities of what is met or not."""
    return np.where(dark, np.uint8(PART_LUMINOSITY), np.uint8(WHITE))
