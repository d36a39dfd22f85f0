"""Small films of moving bodies, made from descriptions alone."""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.motion import Watched
from testbed.student.seeing.alternatives import own_limbs
from testbed.student.seeing.articulated import describe, lay_out
from testbed.vision.camera import StereoRig
from testbed.vision.silhouette import coverage

RIG = StereoRig()


def film(
    body: Morphology,
    waves: list[tuple[float, float, float]],
    *,
    frames: int = 16,
    depth: float = 1.0,
    facing: int = 1,
    yaw: float = 0.05,
    roll_deg: float = 6.0,
    noise: float = 2.0,
) -> tuple[Watched, Vector]:
    """What a rig sees of a body whose joints follow (centre, amplitude, phase) in degrees, and the parts (F, k, 8).

    One period lasts 2 s; parts are in the order of ``own_limbs``.
    """
    plan = lay_out(own_limbs(body)[0], facing)
    times = np.arange(frames) / 7.5
    x = np.zeros((frames, plan.pose + plan.shared))
    x[:, plan.find("along", 0)] = -0.08 * facing + 0.02 * np.sin(math.pi * times)
    x[:, plan.find("up", 0)] = 0.12
    x[:, plan.find("turn", 0)] = np.radians(roll_deg) * np.sin(math.pi * times)
    for joint, (centre, amplitude, phase) in enumerate(waves, start=1):
        angle = centre + amplitude * np.sin(math.pi * times + math.radians(phase))
        x[:, plan.find("turn", joint)] = np.radians(angle)
    x[:, plan.find("depth")] = depth
    x[:, plan.find("yaw")] = yaw
    parts = describe(plan, x)
    rng = np.random.default_rng(frames)
    clean = np.stack([coverage(row, RIG) for row in parts])
    images = 255 - 180 * clean + rng.normal(0, noise, clean.shape)
    return Watched(np.clip(np.rint(images), 0, 255).astype(np.uint8), times), parts
