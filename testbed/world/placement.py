"""Where everybody stands: the scenario's distances and bearings as coordinates of the ground."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from testbed.bodies.morphology import Morphology
from testbed.scenario.specs import Scenario
from testbed.scenario.teacher import TeacherSpec

STUDENT = "student"


@dataclass(frozen=True)
class Placement:
    """A spot on the ground.

    Attributes:
        place: World x and y of the main body's centre, in metres; the rig's post is the origin.
        yaw: Heading of the body's x axis, rad, counter-clockwise seen from above.
        bearing: Direction in which the rig sees the middle of the flat body, rad, positive to the right.
        height: Of what it stands on, in metres.
    """

    place: tuple[float, float]
    yaw: float
    bearing: float
    height: float = 0.0


def teacher_names(scenario: Scenario) -> tuple[str, ...]:
    """``teacher_0``, ``teacher_1``, ... in the scenario's order."""
    return tuple(f"teacher_{index}" for index in range(len(scenario.teachers)))


def placements(scenario: Scenario, bodies: Mapping[str, Morphology]) -> dict[str, Placement]:
    """Everybody's spot, the student first.

    The middle of a flat teacher is at its ``distance`` and ``bearing_deg``. With ``facing_deg: 0`` it lies sideways
    to the line of sight, its x axis to the rig's right; positive facing turns it away from the rig. A mirrored gait is
    performed by a teacher that stands as in a mirror.
    """
    x, y = scenario.student.position
    spots = {STUDENT: Placement((x, y), 0.0, math.atan2(x, y))}
    for name, teacher in zip(teacher_names(scenario), scenario.teachers, strict=True):
        spots[name] = placed(teacher, bodies[name])
    return spots


def placed(teacher: TeacherSpec, body: Morphology) -> Placement:
    """A teacher's spot, see :func:`placements`."""
    bearing = math.radians(teacher.bearing_deg)
    facing = 180 - teacher.facing_deg if teacher.gait.mirrored else teacher.facing_deg
    yaw = math.radians(facing) - bearing
    nearest, farthest, _ = body.reach()
    middle = (nearest + farthest) / 2
    x = teacher.distance * math.sin(bearing) - middle * math.cos(yaw)
    y = teacher.distance * math.cos(bearing) - middle * math.sin(yaw)
    return Placement((x, y), yaw, bearing, teacher.height)
