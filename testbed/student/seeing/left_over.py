"""What no body that the student can think of explains: is it a body more? An extension of Section 3.3.2.

Two bodies in one outline look like one that nobody thought of. Whatever the best thinkable body leaves over of that is
limbs, if it is one strange body, and a second main body, if it is two.
"""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from testbed.frozen import Frozen
from testbed.student.seeing.evidence import Explanation
from testbed.student.seeing.fitting import Film
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import CUBOID, D1, D3, SHAPE, Z
from testbed.vision.silhouette import coverage

_FINE = 3  # columns and rows in those of an image: a main body is some five pixels high


class LeftOverParameters(Frozen):
    """When what is left over may be another body. Measured on single strange bodies and on two in one outline."""

    thick: float = Field(
        0.75,
        gt=0,
        description="As thick as a main body is what has this share of the own one's thickness; limbs have half.",
    )
    telling: float = Field(
        0.01,
        gt=0,
        lt=1,
        description="From this share of the outline on it is said that there may be more than one body.",
    )


def left_over(
    film: Film, rig: StereoRig, best: Explanation, own: Explanation, parameters: LeftOverParameters
) -> float:
    """Share of the darkness in the key frames that ``best`` does not cover and that is as thick as a main body.

    How thick that is tells the size at which the ``own`` body fits best.
    """
    main = own.motion.parts[:, 0]
    thickness = np.where(main[:, SHAPE] == CUBOID, main[:, D3], 2 * main[:, D1])
    thick = float(np.median(thickness / main[:, Z])) * rig.focal
    width = max(1, round(parameters.thick * thick * _FINE))
    block = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    at = np.searchsorted(best.motion.times, film.times[film.keys])
    alpha, left = np.maximum(film.eyes.alpha[film.keys], 0), 0.0
    for parts, pair in zip(best.motion.parts[at], film.eyes.alpha[film.keys], strict=True):
        for rest in np.clip(pair - coverage(parts, rig), 0, 1):
            fine = cv2.resize(rest, None, fx=_FINE, fy=_FINE, interpolation=cv2.INTER_LINEAR)
            left += float(cv2.morphologyEx((fine > 0.5).astype(np.uint8), cv2.MORPH_OPEN, block).sum())
    return left / _FINE**2 / max(float(alpha.sum()), 1e-9)
