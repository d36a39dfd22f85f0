"""Students by name, and the method of each phase of their lives: see :mod:`testbed.student.phases`."""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol

from testbed.student.parameters import StudentParameters

SelfDiscovery = Literal["hill_climber", "active"]
TeacherModelling = Literal["eea", "joint_fit", "embodied"]
Imitation = Literal["hill_climber", "rehearsed"]
VerdictRule = Literal["controller", "attachment", "likelihood"]


class Phases(NamedTuple):
    """Which method a mind uses in each phase of its life."""

    self_discovery: SelfDiscovery
    teacher_modelling: TeacherModelling
    imitation: Imitation
    verdict: VerdictRule


METHODS = {
    "paper": Phases("hill_climber", "eea", "hill_climber", "controller"),
    "like_me": Phases("active", "embodied", "rehearsed", "likelihood"),
}
"""What each student does where the scenario does not say otherwise: ``paper`` to the letter of Sections 3.2, 3.3 and
3.4, ``like_me`` with this project's extensions."""

STUDENT_METHODS = tuple(METHODS)


class MindPlan(Protocol):
    """How a mind thinks, as a scenario says it."""

    @property
    def name(self) -> str:
        """What reports call it."""
        ...

    @property
    def phases(self) -> Phases:
        """The method of every phase."""
        ...

    @property
    def parameters(self) -> StudentParameters:
        """What the methods leave open."""
        ...
