"""A film with one of two bodies alone that run into each other (an extension of Section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.student.candidates_depth import (
    FINE,
    Depths,
    Images,
    PartingParameters,
    Vector,
    block_of,
    disparities,
    finer,
)
from testbed.vision.camera import StereoRig
from testbed.vision.foreground import foreground


class Parted(NamedTuple):
    """One of two bodies alone.

    Attributes:
        frames: (F, 2, height, width) with background in the other's place.
        touched: (F, 2) where the two outlines touch.
        unseen: (F, 2, height, width) what cannot be known of it: the farther is hidden by the nearer, and where the two
            meet edges are uncertain.
    """

    frames: Images
    touched: NDArray[np.bool_]
    unseen: NDArray[np.bool_]


def body_at(
    frames: Images,
    rig: StereoRig,
    depths: Depths,
    dark_below: int,
    parameters: PartingParameters,
    *,
    near: bool,
) -> Parted:
    """A film with one of two bodies alone: the one whose shift suits a pixel's surroundings better.

    Args:
        frames: (F, 2, height, width) with both bodies.
        rig: The eyes that saw them.
        depths: At which distances they are.
        dark_below: Luminosity below which a pixel is foreground.
        parameters: See :class:`PartingParameters`.
        near: Which one is kept.
    """
    kept, touched, unseen = frames.copy(), np.zeros(frames.shape[:2], bool), np.zeros(frames.shape, bool)
    for number, pair in enumerate(frames):
        gain, shifts = _gain(pair, depths, parameters), disparities(pair, rig, dark_below, parameters)
        for eye, image in enumerate(pair):
            dark = foreground(image, dark_below)
            nearer = gain[eye] + parameters.hint * _neighbours(shifts[eye] - depths.gap) > 0
            other = _without_flecks(nearer, dark, parameters.fleck) != near
            his, mine = dark & other, dark & ~other
            touched[number, eye] = bool((_grown(his, 1) & mine).any())
            unseen[number, eye] = _grown(his, 1) & _grown(mine, 1) if near else _grown(his, 2)
            kept[number, eye][other] = np.median(image)
    return Parted(kept, touched, unseen)


def _grown(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """With so many pixels around."""
    block = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), block) > 0)


def _without_flecks(nearer: NDArray[np.bool_], dark: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """Pieces of fewer dark pixels than ``size`` go to the body around them."""
    changed = nearer.copy()
    for body in (nearer, ~nearer):
        _, pieces, about, _ = cv2.connectedComponentsWithStats((dark & body).astype(np.uint8))
        changed ^= (about[:, cv2.CC_STAT_AREA] < size)[pieces] & dark & body
    return changed


def _neighbours(sides: Vector) -> Vector:
    """(height, width) on which side of the gap, 1 or -1, the nearest pixel is of which that is known, or 0."""
    known = np.isfinite(sides)
    if not known.any():
        return np.zeros((len(sides), sides.shape[1] // FINE))
    _, cells = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    side = np.zeros(int(cells.max()) + 1)
    side[cells[known]] = np.where(sides[known] >= 0, 1.0, -1.0)
    return np.asarray(side[cells][:, ::FINE])


def _gain(pair: Images, depths: Depths, parameters: PartingParameters) -> Vector:
    """(2, height, width) by how much (grey levels) the shift of the nearer heap fits better than the other's."""
    left, right = (finer(image) for image in pair)
    fine, gains = left.shape[1], []
    around = parameters.thick
    heaps = (
        (max(depths.near - around, depths.gap), depths.near + around),
        (max(depths.far - around, 0.0), min(depths.far + around, depths.gap)),
    )
    for image, there, sign in ((left, right, 1), (right, left, -1)):
        gain = np.zeros_like(image)
        for window in parameters.windows:
            block = block_of(window)
            costs = []
            for least, most in heaps:
                tried = []
                for shift in range(round(least * FINE), round(most * FINE) + 1):
                    seen, other = slice(shift, None), slice(None, fine - shift)
                    mine, its = (seen, other) if sign > 0 else (other, seen)
                    gap = np.full_like(image, parameters.differ)
                    gap[:, mine] = np.minimum(np.abs(image[:, mine] - there[:, its]), parameters.differ)
                    tried.append(cv2.boxFilter(gap, -1, block, normalize=False))
                costs.append(np.min(tried, axis=0))
            gain += (costs[1] - costs[0]) / (block[0] * block[1])
        unseen = round(heaps[0][1] * FINE)  # columns whose counterpart may be out of the other eye's view
        gain[:, slice(None, unseen) if sign > 0 else slice(fine - unseen, None)] = 0
        gains.append(gain.reshape(len(image), -1, FINE).sum(axis=2))
    return np.array(gains, float)


def bearing_of(frames: Images, rig: StereoRig, dark_below: int) -> float | None:
    """Direction of the middle of what is dark in a film, rad from the middle of the view; None if nothing is."""
    angles = np.arctan((np.arange(rig.width) + 0.5 - rig.width / 2) / rig.focal)
    dark: NDArray[np.bool_] = np.any(foreground(frames, dark_below), axis=2)  # (F, 2, width)
    middles = [
        np.median(
            [
                (angles[seen[0]] + angles[seen[-1]]) / 2
                for image in eye
                if (seen := np.flatnonzero(image)).size
            ]
        )
        for eye in dark.swapaxes(0, 1)
        if eye.any()
    ]
    return float(np.mean(middles)) if len(middles) == 2 else None
