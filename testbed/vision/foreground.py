"""Telling robots from the light background, and candidates from one another."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from testbed.vision.camera import StereoRig


def foreground(image: NDArray[np.uint8], dark_below: int) -> NDArray[np.bool_]:
    """Where an image (any shape) is darker than ``dark_below``."""
    return image < dark_below


def find_candidates(
    views: Iterable[tuple[float, NDArray[np.uint8]]],
    rig: StereoRig,
    *,
    dark_below: int,
    gap: float,
    narrowest: float,
) -> list[float]:
    """The bearings of whatever stands out from the background.

    Every dark column of every view points in a direction; directions that lie close together are one candidate.

    Args:
        views: Pairs of a pan angle (rad) and a (height, width) image that one camera of the rig took there.
        rig: The rig; parallax between its eyes is neglected.
        dark_below: Luminosity below which a pixel is foreground.
        gap: Directions further apart than this (rad) belong to two candidates.
        narrowest: Candidates narrower than this (rad) are dropped.

    Returns:
        Bearing of each candidate's middle, rad, from left to right.
    """
    columns = (np.arange(rig.width) + 0.5 - rig.width / 2) / rig.focal
    directions = np.sort(
        np.concatenate(
            [pan + np.arctan(columns[foreground(image, dark_below).any(axis=0)]) for pan, image in views]
            or [np.empty(0)]
        )
    )
    groups = np.split(directions, np.flatnonzero(np.diff(directions) > gap) + 1)
    return [
        float(group[0] + group[-1]) / 2
        for group in groups
        if group.size and group[-1] - group[0] >= max(narrowest, math.ulp(1.0))
    ]
