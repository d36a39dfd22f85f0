"""Telling robots from the light background, and candidates from one another."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

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
    beyond = np.abs(directions) > math.pi  # seen again from the other end of the sweep
    directions[beyond] -= math.tau * np.sign(directions[beyond])
    directions.sort()
    groups = np.split(directions, np.flatnonzero(np.diff(directions) > gap) + 1)
    if len(groups) > 1 and groups[0][0] + math.tau - groups[-1][-1] <= gap:  # one who stands behind
        groups = [*groups[1:-1], np.concatenate([groups[-1], groups[0] + math.tau])]
    middles = [
        math.remainder(float(group[0] + group[-1]) / 2, math.tau)
        for group in groups
        if group.size and group[-1] - group[0] >= max(narrowest, math.ulp(1.0))
    ]
    return sorted(middles)


class Alone(NamedTuple):
    """One candidate's images without the others.

    Attributes:
        frames: (F, 2, height, width) where somebody else was, there is background now.
        touched: (F, 2) where somebody else's outline ran into the candidate's own, so that the two cannot be parted.
    """

    frames: NDArray[np.uint8]
    touched: NDArray[np.bool_]


def without_others(
    frames: NDArray[np.uint8], rig: StereoRig, others: Sequence[float], *, dark_below: int, gap: int = 2
) -> Alone:
    """Paint over whoever else stands in the images of the candidate that the rig looks at.

    Dark columns that lie together are one outline. It belongs to the candidate whose direction it covers, or else to
    the one whose direction is nearest.

    Args:
        frames: (F, 2, height, width) luminosity, left then right.
        rig: The eyes; parallax between them is neglected, as when candidates are found.
        others: Bearings of the other candidates from the middle of the view, rad; those behind do not matter.
        dark_below: Luminosity below which a pixel is foreground.
        gap: So many light columns part two outlines.

    Returns:
        The frames, the same ones if nobody else was in them.
    """
    touched = np.zeros(frames.shape[:2], bool)
    angles = np.arctan((np.arange(rig.width + 1) - rig.width / 2) / rig.focal)  # of the columns' edges
    near = [other for other in others if abs(other) < 2 * angles[-1]]
    if not near:
        return Alone(frames, touched)
    kept = frames.copy()
    for where in np.ndindex(*touched.shape):
        image = frames[where]
        for first, last in _outlines(image, dark_below, gap):
            own = _beside(0.0, angles[first], angles[last])
            nearest = min(_beside(other, angles[first], angles[last]) for other in near)
            if own == nearest == 0:
                touched[where] = True
            elif nearest < own:
                margin = slice(max(first - 1, 0), last + 1)
                kept[where][:, margin] = np.median(image)
    return Alone(kept, touched)


def is_ahead(
    image: NDArray[np.uint8], rig: StereoRig, within: float, *, dark_below: int, gap: int = 2
) -> bool:
    """Whether the middle of somebody in an image is less than ``within`` (rad) from its middle.

    Who stands half out of view does not count, for where its middle is cannot be told.
    """
    for first, last in _outlines(image, dark_below, gap):
        middle = (first + last) / 2 - rig.width / 2
        if (first == 0) == (last == rig.width) and abs(math.atan(middle / rig.focal)) < within:
            return True
    return False


def _outlines(image: NDArray[np.uint8], dark_below: int, gap: int) -> list[tuple[int, int]]:
    """First column of each outline in an image, and the one after its last; so many light columns part two."""
    dark = np.flatnonzero(foreground(image, dark_below).any(axis=0))
    if not dark.size:
        return []
    parts = np.split(dark, np.flatnonzero(np.diff(dark) > gap) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]


def _beside(direction: float, first: float, last: float) -> float:
    """How far (rad) a direction lies beside an outline; 0 within it."""
    return max(first - direction, direction - last, 0.0)
