"""What the phases of a life hand to one another, however they are done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.self_model import BodyPrior, Tree
from testbed.student.motion import TeacherMotion

Told = Callable[[int, int], None]
"""Called with how much of a phase is done, and how much there is."""


class Self(Protocol):
    """What a mind found out about its body (Section 3.2)."""

    @property
    def body(self) -> Morphology:
        """The self-model."""
        ...

    @property
    def stages(self) -> tuple[tuple[Tree, Vector], ...]:
        """The best self-model after each step: on what the limbs hang, and at what angles (limbs,) rad."""
        ...

    @property
    def errors(self) -> Vector:
        """Its error after each step, Eq. 1, rad."""
        ...

    @property
    def commands(self) -> Vector:
        """(n, joints) the commands that it tried, rad."""
        ...

    @property
    def tilt(self) -> Vector:
        """(n, 2) how they tilted the body, rad."""
        ...


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
