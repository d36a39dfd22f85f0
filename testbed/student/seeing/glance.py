"""A glance at a candidate: how far away it is and what its outline looks like, without a model of its parts.

What the baselines ``random``, ``nearest`` and ``lookalike`` go by. The outline is described by numbers that do not
depend on size or distance: a small teacher of the student's kind looks like its kind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.motion import TeacherMotion, Watched
from testbed.student.moving.rolls import headings, roll_of
from testbed.student.parameters import GlanceParameters
from testbed.student.seeing.posing import depth_of
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import CAPPED_CYLINDER, CUBOID, SPHERE
from testbed.vision.silhouette import coverage, darkness

_FEATURES = 7


@dataclass(frozen=True)
class Glance:
    """What a glance tells.

    Attributes:
        motion: Of no parts: a glance models none.
        distance: Median over the frames, by disparity, m.
        looks: (frames, 7) outlines in numbers, see :func:`look_of`; frames in which nothing is seen are left out.
        likeness: Mean log density of these looks among those of the own body, without its constant; NaN if unknown.
    """

    motion: TeacherMotion
    distance: float
    looks: Vector
    likeness: float


def glance(
    watched: Watched,
    rig: StereoRig,
    body: Morphology | None,
    parameters: GlanceParameters,
    rng: np.random.Generator,
) -> Glance:
    """Look at a candidate without modelling it.

    Args:
        watched: Stereo pairs.
        rig: The eyes that saw them.
        body: Whose looks to compare with: the album shows it from the side in random postures. None: nobody's.
        parameters: See :class:`GlanceParameters`.
        rng: Chooses the postures.
    """
    alpha = darkness(watched.frames, parameters.silhouette)
    looks = np.array([look for image in alpha[:, 0] if (look := look_of(image)) is not None])
    looks = looks.reshape(-1, _FEATURES)
    likeness = math.nan
    if body is not None and len(looks):
        likeness = _likeness(looks, album(body, rig, parameters, rng), parameters)
    motion = TeacherMotion(np.asarray(watched.times, float), np.empty((len(watched.times), 0, 8)))
    return Glance(motion, depth_of(alpha, rig), looks, likeness)


def look_of(image: NDArray[np.floating]) -> Vector | None:
    """(7,) an outline in numbers that neither its size nor its place changes; None if there is none.

    Height and width of the smallest upright box in roots of the area, the share of its convex hull that is filled,
    and the logarithms of the first four Hu moments. ``image`` (height, width) is darkness from 0 to 1.
    """
    solid = (image > 0.5).astype(np.uint8)
    area = int(solid.sum())
    if area < 3:
        return None
    outlines, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate(outlines)
    _, _, width, height = cv2.boundingRect(points)
    hull = np.zeros_like(solid)
    cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
    moments = cv2.HuMoments(cv2.moments(solid, binaryImage=True)).ravel()[:4]
    return np.array(
        [
            math.log(height / math.sqrt(area)),
            math.log(width / math.sqrt(area)),
            area / max(int(hull.sum()), area),
            *np.log(np.maximum(np.abs(moments), 1e-12)),
        ]
    )


def album(body: Morphology, rig: StereoRig, parameters: GlanceParameters, rng: np.random.Generator) -> Vector:
    """(pictures, 7) how a body looks from the side, in random postures, its main body leaning a little."""
    looks: list[Vector] = []
    while len(looks) < parameters.pictures:
        posture = np.asarray(rng.uniform(*body.limits.T), float)
        lean = rng.uniform(-1, 1) * math.radians(parameters.lean_deg)
        distance = parameters.album_distance * float(np.exp(rng.uniform(-0.5, 0.5)))
        look = look_of(coverage(_from_the_side(body, posture, lean, distance), rig)[0])
        if look is not None:
            looks.append(look)
    return np.array(looks)


def _from_the_side(body: Morphology, posture: Vector, lean: float, distance: float) -> Vector:
    """(parts, 8) a body before the rig, upright but for ``lean`` (rad)."""
    right = np.array([1.0, 0.0, 0.0])
    base = np.array([[0, 0, 0, 0, math.sin(lean / 2), 0, math.cos(lean / 2)]])
    rolls = roll_of(headings(body, base, posture[None])[0], right)
    turn = np.array([[math.cos(lean), 0, math.sin(lean)], [0, 1, 0], [-math.sin(lean), 0, math.cos(lean)]])
    centres = np.array([turn @ pose[:3, 3] for pose in body.poses(posture).values()])
    middle = centres.mean(axis=0)
    rows = []
    for part, centre, roll in zip(body.parts.values(), centres - middle, rolls, strict=True):
        shape, *sizes = _shape_of(part)
        rows.append([shape, centre[0], -centre[2], distance + centre[1], roll, *sizes])
    return np.array(rows)


def _shape_of(part: object) -> tuple[float, float, float, float]:
    size, radius = getattr(part, "size", None), getattr(part, "radius", 0.0)
    if size is not None:
        return CUBOID, size[0], size[1], size[2]
    length = getattr(part, "length", None)
    return (SPHERE, radius, 0.0, 0.0) if length is None else (CAPPED_CYLINDER, radius, length, 0.0)


def _likeness(looks: Vector, pictures: Vector, parameters: GlanceParameters) -> float:
    """Mean over the looks of the log density by a Gaussian kernel over the album, in whitened numbers."""
    middle, spread = pictures.mean(axis=0), np.maximum(pictures.std(axis=0), 1e-6)
    a, b = (looks - middle) / spread, (pictures - middle) / spread
    gaps = np.sum((a[:, None] - b[None]) ** 2, axis=2) / (2 * parameters.bandwidth**2)
    least = gaps.min(axis=1)
    return float(np.mean(np.log(np.mean(np.exp(least[:, None] - gaps), axis=1)) - least))
