"""What the phases of a life hand to one another, however they are done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.self_model import BodyPrior
from testbed.student.motion import TeacherMotion

Told = Callable[[int, int], None]
"""Called with how much of a phase is done, and how much there is."""


class Modelled(Protocol):
    """A teacher model, however it came about."""

    @property
    def motion(self) -> TeacherMotion:
        """How its objects moved."""
        ...


class Imitated(Protocol):
    """An attempt to move like a teacher, however it was made; see ``imitation.ImitationRecord``."""

    teacher_rolls: Vector
    order: NDArray[np.int64]
    weights: Vector
    errors: Vector
    responses: tuple[Vector, ...]
    limits: Vector


@dataclass(frozen=True)
class Own:
    """What the student knows of itself: beforehand, and after self-discovery; a baseline, what it is told."""

    prior: BodyPrior
    body: Morphology
    told: Callable[[], Vector | None] | None = None
