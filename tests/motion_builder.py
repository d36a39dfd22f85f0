"""Motions of bodies that move as they would, and what a good eye sees of them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from testbed.bodies.morphology import Morphology, Vector, load_robot
from testbed.student.body.imagination import Imagination
from testbed.student.body.settling import Settler
from testbed.student.motion import TeacherMotion
from testbed.student.moving.rehearsal import RehearsalRecord, rehearse
from testbed.student.moving.rolls import headings, roll_of, view_of
from testbed.student.parameters import ImaginationParameters, RehearsalParameters
from testbed.vision.primitives import CAPPED_CYLINDER, CUBOID, OMEGA, X

STEP = 1 / 60
PERIOD = 2.0
TIMES = np.arange(60) / 15
CRAWL = ((0.0, 33.0, 0.0), (65.0, 20.0, 120.0))  # centre, amplitude, phase of each joint, deg
CRAWLER = load_robot("crawler")


def gait(times: Vector, waves: tuple[tuple[float, float, float], ...]) -> Vector:
    centre, amplitude, phase = np.radians(np.array(waves)).T
    return np.asarray(centre + amplitude * np.sin(2 * math.pi / PERIOD * times[:, None] + phase))


def motion_of(
    body: Morphology, bases: Vector, joints: Vector, times: Vector, *, scale: float = 1.0, noise: float = 0.0
) -> TeacherMotion:
    """What a perfect eye (and an eye with ``noise`` in deg) sees of a body in these poses."""
    right = view_of(body)[0]
    rolls = roll_of(headings(body, bases, joints), right)
    parts = np.zeros((len(times), len(body.parts), 8))
    for frame, angles in enumerate(joints):
        for place, (part, pose) in enumerate(
            zip(body.parts.values(), body.poses(angles).values(), strict=True)
        ):
            x, y = pose[:3, 3] @ right, -pose[2, 3]
            roll = rolls[frame, 0] - (0.0 if right[0] > 0 else math.pi)
            shape = CUBOID if part.shape == "cuboid" else CAPPED_CYLINDER
            size = part.size if part.shape == "cuboid" else (part.radius, part.length, 0.0)  # type: ignore[union-attr]
            centre = (x * math.cos(roll) - y * math.sin(roll), x * math.sin(roll) + y * math.cos(roll))
            parts[frame, place] = (shape, *centre, 1.0, rolls[frame, place], *size)
        parts[frame, :, X] += bases[frame, :3] @ right
    parts[:, :, 1:4] *= scale
    parts[:, :, 5:] *= scale
    rng = np.random.default_rng(0)
    parts[:, :, OMEGA] = np.unwrap(parts[:, :, OMEGA], axis=0) + rng.normal(
        0, math.radians(noise), rolls.shape
    )
    return TeacherMotion(times, parts)


@functools.cache
def crawling(noise: float = 2.0, scale: float = 1.0) -> TeacherMotion:
    """The crawler at its gait in the physical simulation, after it has settled into it."""
    with Imagination(ImaginationParameters(), STEP) as mind, mind.imagine(CRAWLER) as rehearsal:
        bases, joints = rehearsal.move(gait(np.linspace(0, 6, 360, endpoint=False), CRAWL))
    return motion_of(CRAWLER, bases[120::4], joints[120::4], TIMES, scale=scale, noise=noise)


def quasi_static(body: Morphology, waves: tuple[tuple[float, float, float], ...]) -> TeacherMotion:
    bases, joints = Settler(body).follow(gait(TIMES, waves))
    return motion_of(body, bases, joints, TIMES, noise=2.0)


def mirrored(motion: TeacherMotion) -> TeacherMotion:
    parts = motion.parts.copy()
    parts[:, :, OMEGA] = math.pi - parts[:, :, OMEGA]
    parts[:, :, X] *= -1
    return TeacherMotion(motion.times, parts)


@functools.cache
def rehearsed(kind: str = "crawler") -> RehearsalRecord:
    """What the crawler makes of a motion of this kind."""
    splayed = CRAWLER.varied(joints={"joint_b": {"parent": "body", "angle_deg": 180}})
    motions: dict[str, Callable[[], TeacherMotion]] = {
        "crawler": crawling,
        "mirrored": lambda: mirrored(crawling()),
        "swapped": lambda: TeacherMotion(TIMES, crawling().parts[:, [0, 2, 1]]),
        "splayed": lambda: quasi_static(splayed, ((20.0, 30.0, 0.0), (40.0, 25.0, 120.0))),
        "locked": lambda: quasi_static(CRAWLER, ((10.0, 30.0, 0.0), (40.0, 0.0, 0.0))),
        "rigid": lambda: quasi_static(CRAWLER, ((10.0, 0.0, 0.0), (40.0, 0.0, 0.0))),
    }
    return rehearse(CRAWLER, motions[kind](), None, RehearsalParameters(), np.random.default_rng(1))
