"""What the rig can see of a body: from how near it fits into both images, and how wide it is from where it stands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from testbed.scenario.specs import RigSpec
from testbed.scenario.teacher import TeacherSpec

if TYPE_CHECKING:
    from testbed.bodies.morphology import Morphology
    from testbed.world.placement import Placement

Ends = list[tuple[float, float]]
IMAGE_ASPECT = 75 / 100  # height over width, in pixels
MOST_PAN_ERRORS = 2.0  # standard deviations
_CLOSENESS = 1e-9  # metres


def nearest_distance(body: Morphology, teacher: TeacherSpec, rig: RigSpec) -> float:
    """How near (m) a teacher may stand to be seen whole by both cameras, stretched out or upright."""
    from testbed.world.placement import placed  # the world is made of scenarios

    # A pinhole sees the point (x, y, z) of its frame if |x| and |y| stay below z times a tangent.
    half = math.radians(rig.field_of_view_deg) / 2
    aside = math.radians(most_pan_error_deg(rig))
    across, up = math.tan(max(half - aside, half / 4)), IMAGE_ASPECT * math.tan(half)
    ends = ends_of(body, placed(teacher, body))
    nearer = [(abs(x) + rig.baseline / 2) / across - (z - teacher.distance) for x, z in ends]
    _, _, highest = body.reach()
    above, below = highest + teacher.height - rig.height, rig.height - teacher.height
    return max(*nearer, above / up, below / up)


def most_pan_error_deg(rig: RigSpec) -> float:
    """How far off its target the rig comes to rest at most, in degrees."""
    return MOST_PAN_ERRORS * rig.pan_error_deg


def half_width_deg(ends: Ends, rig: RigSpec) -> float:
    """How far to the side of its bearing a body can be seen by either camera, in degrees."""
    widest = 0.0
    for x, depth in ends:
        away = math.hypot(x, depth)
        parallax = math.asin(min(1.0, rig.baseline / 2 / max(away, _CLOSENESS)))
        widest = max(widest, abs(math.atan2(x, depth)) + parallax)
    return math.degrees(widest)


def ends_of(body: Morphology, spot: Placement) -> Ends:
    """The flat body's two ends in the frame of a rig that looks its way: to the right and in depth (m)."""
    sine, cosine = math.sin(spot.bearing), math.cos(spot.bearing)
    ends = []
    for along in body.reach()[:2]:
        x = spot.place[0] + along * math.cos(spot.yaw)
        y = spot.place[1] + along * math.sin(spot.yaw)
        ends.append((x * cosine - y * sine, x * sine + y * cosine))
    return ends
