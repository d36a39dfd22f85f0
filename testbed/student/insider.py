"""What only baselines are told: the student's body, and how a candidate really moves.

The student of the paper knows neither, nor does any other student of this project: only a mind whose phases are
:attr:`~testbed.student.methods.Phases.privileged` is given an insider. What such a mind reaches is what knowing is
worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.self_model import Tree, true_tree
from testbed.student.motion import TeacherMotion
from testbed.vision.primitives import OMEGA


@dataclass(frozen=True)
class Insider:
    """Somebody who knows.

    Attributes:
        body: The student's body as its builders know it.
        parts_of: From a bearing (rad) and action counts (F,) to the true parts (F, n, 8) of whoever stands there,
            Eq. 2, main body first and limbs in motor order; None if nobody does.
    """

    body: Morphology
    parts_of: Callable[[float, tuple[int, ...]], Vector | None]


@dataclass(frozen=True)
class KnownBody:
    """A body that nobody had to discover."""

    body: Morphology

    @property
    def stages(self) -> tuple[tuple[Tree, Vector], ...]:
        """What was known from the beginning."""
        return (true_tree(self.body),)

    @property
    def errors(self) -> Vector:
        """(1,) zero: nothing was felt that it could contradict."""
        return np.zeros(1)

    @property
    def commands(self) -> Vector:
        """(0, joints) none were tried."""
        return np.empty((0, len(self.body.joints)))

    @property
    def tilt(self) -> Vector:
        """(0, 2)."""
        return np.empty((0, 2))


@dataclass(frozen=True)
class Insight:
    """A teacher model that is the truth, as far as it fits into as many parts as the student has.

    Attributes:
        motion: How the parts moved.
        explained: The share of the parts that could be told: a body with more of them, or fewer, is not the own.
    """

    motion: TeacherMotion
    explained: float


def insight(times: Vector, parts: Vector | None, count: int) -> Insight:
    """The true parts (F, n, 8) seen at ``times`` (F,) s as ``count`` objects; nobody stands still."""
    if parts is None or not parts.shape[1]:
        return Insight(TeacherMotion(times, np.zeros((len(times), count, 8))), 0.0)
    there = parts.shape[1]
    which = np.minimum(np.arange(count), there - 1)
    told = parts[:, which].copy()
    told[..., OMEGA] = np.unwrap(told[..., OMEGA], axis=0)
    return Insight(TeacherMotion(times, told), min(count, there) / max(count, there))
