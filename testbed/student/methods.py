"""Students by name, and the method of each phase of their lives: see :mod:`testbed.student.phases`."""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol

from testbed.student.parameters import StudentParameters

SelfDiscovery = Literal["hill_climber", "active", "known"]
TeacherModelling = Literal["eea", "joint_fit", "embodied", "glance", "insight"]
Imitation = Literal["hill_climber", "rehearsed", "none"]
VerdictRule = Literal["controller", "attachment", "likelihood", "chance", "nearest", "look"]


class Phases(NamedTuple):
    """Which method a mind uses in each phase of its life."""

    self_discovery: SelfDiscovery
    teacher_modelling: TeacherModelling
    imitation: Imitation
    verdict: VerdictRule

    @property
    def privileged(self) -> bool:
        """Whether such a mind is told what no student can sense."""
        return not PRIVILEGED.isdisjoint(self)


METHODS = {
    "paper": Phases("hill_climber", "eea", "hill_climber", "controller"),
    "like_me": Phases("active", "embodied", "rehearsed", "likelihood"),
    "random": Phases("known", "glance", "none", "chance"),
    "nearest": Phases("known", "glance", "none", "nearest"),
    "lookalike": Phases("known", "glance", "none", "look"),
    "known_body": Phases("known", "embodied", "rehearsed", "likelihood"),
    "oracle": Phases("known", "insight", "rehearsed", "controller"),
}
"""What each student does where the scenario does not say otherwise: ``paper`` to the letter of Sections 3.2, 3.3 and
3.4, ``like_me`` with this project's extensions. The others are baselines: they guess, go by distance or by looks, know
their body beforehand, or know besides how everybody's joints really move."""

PRIVILEGED = frozenset({"known", "insight"})
"""Phases that ask an :class:`~testbed.student.insider.Insider`."""

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
