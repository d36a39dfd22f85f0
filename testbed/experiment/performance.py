"""How far the imitating student came, and its teacher: the truth about phase four."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import Morphology, Vector
from testbed.experiment.record import Row
from testbed.world.placement import STUDENT

Arrays = Mapping[str, NDArray[Any]]

COLUMNS = (
    "path_length",
    "path_forward",
    "performed_seconds",
    "teacher_forward",
    "watched_seconds",
    "distance_ratio",
)
_STOOD_STILL = 0.002
"""A teacher that came less far than this (m) between the first and the last look has no direction to compare with."""


def performance_row(arrays: Arrays, name: str, log: Arrays, bodies: Mapping[str, Morphology]) -> Row:
    """The columns of the teacher that the student imitated.

    ``path_length`` (m) is the way of the student's main body; ``path_forward`` (m) how far it came along its own x
    axis as it lay at the start, in ``performed_seconds``; ``teacher_forward`` the same of the teacher while it was
    watched. ``distance_ratio`` compares both per second and in body sizes: 1 is as far as the teacher, negative the
    other way; None where the teacher stood still.
    """
    step = float(log["time/control_step"])
    start, steps = int(arrays["perform/start_step"]) - 1, int(arrays["perform/steps"])
    path = arrays["perform/path"][:, :2]
    looks = arrays[f"{name}/look_steps"]
    student = forward(log[f"truth/{STUDENT}/base"], start, start + steps)
    teacher = forward(log[f"truth/{name}/base"], int(looks[0]) - 1, int(looks[-1]) - 1)
    performed, watched = steps * step, float(looks[-1] - looks[0]) * step
    size = _size(bodies[name]) / _size(bodies[STUDENT])
    ratio = None
    if (
        math.isnan(student + teacher) or np.isnan(path).any()
    ):  # nobody knows the truth, or it was carried back
        return {**dict.fromkeys(COLUMNS), "performed_seconds": performed, "watched_seconds": watched}
    if abs(teacher) > _STOOD_STILL and performed > 0 and watched > 0:
        ratio = (student / performed) / (teacher / size / watched)
    return {
        "path_length": float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        "path_forward": student,
        "performed_seconds": performed,
        "teacher_forward": teacher,
        "watched_seconds": watched,
        "distance_ratio": ratio,
    }


def forward(bases: Vector, first: int, last: int) -> float:
    """How far (m) a body came along its own x axis as it lay at the first of its states (t, 7)."""
    if np.isnan(bases[[first, last]]).any():
        return math.nan
    ahead = Rotation.from_quat(bases[first, 3:]).apply([1.0, 0.0, 0.0])[:2]
    length = float(np.linalg.norm(ahead))
    return float((bases[last, :2] - bases[first, :2]) @ ahead) / length if length > 0 else math.nan


def _size(body: Morphology) -> float:
    """The length of the main body, m."""
    return body.parts[body.root].length_along_x
