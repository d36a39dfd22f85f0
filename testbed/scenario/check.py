"""What only the robots' bodies can tell about a scenario: can they do it, and can they be seen?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbed.document_errors import Place
from testbed.documents import Source
from testbed.errors import UserError, did_you_mean
from testbed.recording import read_recording
from testbed.scenario.cells import in_cell, may_be_left_out, probed_cells
from testbed.scenario.drawing import body_at, drawn, extremes
from testbed.scenario.specs import RigSpec, Scenario
from testbed.scenario.view import Ends, ends_of, half_width_deg, most_pan_error_deg, nearest_distance

if TYPE_CHECKING:
    from testbed.bodies.morphology import Morphology, Part, Vector

_ROUNDING_DEG = 1e-6
_ROUNDING = math.radians(_ROUNDING_DEG)
_CLOSENESS = 1e-9  # metres
_SAME_PLACE = 1e-3  # metres
_SIGHT = 20.0  # metres; the rig sees no farther
_POSE = (0.3, -0.4, 0.7, -0.6)  # rad; some pose in which no two different bodies look alike


_TRIED_TRIALS = 3


def check(scenario: Scenario) -> None:
    """Look for what cannot work, in every cell, at the ends of every distribution and in the first trials.

    Unknown robots, a student that no genome describes, impossible gaits, teachers out of view or two in one view, a
    student in its own view, damage to what is not there.

    Raises:
        UserError: For the first such mistake, with the line in the scenario's file and how to mend it.
    """
    for cell in probed_cells(scenario):
        try:
            _check_cell(in_cell(scenario, cell))
        except UserError as error:
            if not may_be_left_out(scenario, cell):
                raise _of_cell(error, scenario, cell) from None


def check_trial(scenario: Scenario, cell: str, trial: int) -> None:
    """Look at one trial of one cell, as :func:`check` does.

    Raises:
        UserError: As :func:`check` does.
    """
    _check_concrete(drawn(in_cell(scenario, cell), trial))


def _check_cell(variant: Scenario) -> None:
    seen: list[Scenario] = []
    trials = range(min(variant.trials, _TRIED_TRIALS))
    for concrete in itertools.chain(extremes(variant), (drawn(variant, trial) for trial in trials)):
        if concrete not in seen:
            seen.append(concrete)
            _check_concrete(concrete)


def _of_cell(error: UserError, scenario: Scenario, cell: str) -> UserError:
    """The same mistake; in a sweep it says in which cell it is met."""
    if not scenario.sweep:
        return error
    mend = f"{error.mend}, or leave such cells out with 'impossible: leave_out'"
    return UserError(f"cell '{cell}': {error.what}", mend, file=error.file, line=error.line)


def _check_concrete(scenario: Scenario) -> None:
    source = scenario.source
    student = body_at(scenario.student, ("student", "robot"), source)
    _check_genome(student, source)
    _check_student_body(student, scenario)
    bodies = [
        body_at(teacher, ("teachers", index, "robot"), source)
        for index, teacher in enumerate(scenario.teachers)
    ]
    _check_drawable(student, bodies, scenario)
    from testbed.world.placement import placements, teacher_names  # the world is made of scenarios

    named = dict(zip(teacher_names(scenario), bodies, strict=True))
    spots = placements(scenario, named)
    ends = [ends_of(body, spots[name]) for name, body in named.items()]
    for index, body in enumerate(bodies):
        _check_gait(index, body, scenario)
        if scenario.world.arrangement == "apart":
            _check_view(index, body, scenario)
    if scenario.world.arrangement == "apart":
        _check_views_apart(ends, scenario)
    _check_student_apart(student, scenario)


def _check_drawable(student: Morphology, teachers: Sequence[Morphology], scenario: Scenario) -> None:
    """Not every renderer draws every body."""
    if scenario.rig.renderer != "analytic":
        return
    from testbed.world.analytic import undrawable  # brings the compiler along

    places: list[tuple[Place, Morphology]] = [(("student", "robot"), student)]
    places += [(("teachers", index, "robot"), body) for index, body in enumerate(teachers)]
    for place, body in places:
        refusal = undrawable(body)
        if refusal is not None:
            raise scenario.source.error(place, refusal.what, refusal.mend)


def _check_student_body(body: Morphology, scenario: Scenario) -> None:
    """What the reality gap and the damage say must be about joints and parts that the student has."""
    student, source = scenario.student, scenario.source
    counts = dict.fromkeys(("servo_offset_deg", "servo_lag", "limb_length"), len(body.joints))
    counts["tilt_bias_deg"] = 2
    counts |= {"density": len(body.parts), "friction": len(body.parts)}
    for name, count in counts.items() if student.reality_gap else ():
        values = getattr(student.reality_gap, name)
        if isinstance(values, tuple) and len(values) != count:
            what = f"student.reality_gap.{name} has {len(values)} values for robot '{body.name}'"
            raise source.error(("student", "reality_gap", name), what, f"give {count}")
    if student.damage is not None:
        limbs = [joint.child for joint in body.joints.values()]
        for key, known in (("limb_lost", limbs), ("joint_locked", list(body.joints))):
            name = getattr(student.damage, key)
            if name is not None and name not in known:
                what = f"student.damage.{key} is '{name}', which robot '{body.name}' does not have"
                raise source.error(("student", "damage", key), what, did_you_mean(name, known))


def _check_genome(body: Morphology, source: Source) -> None:
    """The paper's genome must be able to describe the student's body, or it could never discover itself."""
    from testbed.student.body.self_model import BodyPrior, self_model, true_genome

    place: Place = ("student", "robot")
    if any(part.shape == "mesh" for part in body.parts.values()):
        what = f"robot '{body.name}' is made of meshes, of which the student knows nothing"
        raise source.error(place, what, "give the student a robot of simple parts; meshes may teach")
    try:
        prior, genome = BodyPrior.of(body), true_genome(body)
    except UserError as error:
        raise source.error(place, error.what, error.mend) from None
    model = self_model(prior, genome)
    true, described = (_limbs_in(_POSE, one) for one in (body, model))
    beside = any(joint.across or joint.frame for joint in body.joints.values())
    if beside or np.abs(true - described).max() > _SAME_PLACE:
        what = f"the student's genome cannot describe how the limbs of robot '{body.name}' are joined"
        mend = "list the joints from the main body outward, hinges at the far end of their parent and at height 0"
        raise source.error(place, what, mend)


def _limbs_in(pose: tuple[float, ...], body: Morphology) -> Vector:
    """Where the limbs' centres are, (joints, 3) m, in the order of the joints."""
    poses = body.poses(np.resize(pose, len(body.joints)))
    return np.array([poses[joint.child][:3, 3] for joint in body.joints.values()])


def _check_gait(index: int, body: Morphology, scenario: Scenario) -> None:
    source, gait = scenario.source, scenario.teachers[index].gait
    if gait.kind == "push" and body.joints:
        what = f"the gait pushes robot '{body.name}', which has joints"
        raise source.error(
            ("teachers", index, "gait"), what, "push a ball or a box; others move by themselves"
        )
    if gait.file is not None:
        _check_recording(index, gait.file, body, source)
    for name, motion in gait.joints.items():
        here: Place = ("teachers", index, "gait", "joints", name)
        if name not in body.joints:
            what = f"the gait moves joint '{name}', which robot '{body.name}' does not have"
            raise source.error(here, what, did_you_mean(name, body.joints, kind="joints"))
        (low, high), (least, most) = motion.span_deg, body.joints[name].limits_deg
        if low < least - _ROUNDING_DEG or high > most + _ROUNDING_DEG:
            what = (
                f"the gait swings joint '{name}' from {low:g} to {high:g} degrees, "
                f"but robot '{body.name}' turns it from {least:g} to {most:g}"
            )
            raise source.error(here, what, "lower amplitude_deg or shift centre_deg")


def _check_recording(index: int, file: str, body: Morphology, source: Source) -> None:
    """The joints that were recorded must be the body's, and within their travel."""
    place: Place = ("teachers", index, "gait", "file")
    for name, angles in read_recording(file).angles.items():
        if name not in body.joints:
            what = f"the recording moves joint '{name}', which robot '{body.name}' does not have"
            raise source.error(place, what, did_you_mean(name, body.joints, kind="joints"))
        low, high = body.joints[name].limits
        least, most = float(angles.min()), float(angles.max())
        if least < low - _ROUNDING or most > high + _ROUNDING:
            what = (
                f"the recording turns joint '{name}' from {math.degrees(least):g} to {math.degrees(most):g} degrees, "
                f"robot '{body.name}' only from {math.degrees(low):g} to {math.degrees(high):g}"
            )
            raise source.error(place, what, "record it again, or use another robot")


def _check_view(index: int, body: Morphology, scenario: Scenario) -> None:
    teacher, rig = scenario.teachers[index], scenario.rig
    place: Place = ("teachers", index)
    if abs(teacher.bearing_deg) > rig.pan_limit_deg:
        what = (
            f"bearing {teacher.bearing_deg:g} degrees is beyond the rig's pan limit of {rig.pan_limit_deg:g}"
        )
        mend = "move the teacher or raise rig.pan_limit_deg"
        raise scenario.source.error((*place, "bearing_deg"), what, mend)
    needed = nearest_distance(body, teacher, rig)
    if teacher.distance < needed - _CLOSENESS:
        what = (
            f"robot '{body.name}', stretched out or upright, does not fit in view at {teacher.distance:g} m"
        )
        mend = f"put it at {math.ceil(needed * 100) / 100:g} m or farther, or widen rig.field_of_view_deg"
        raise scenario.source.error((*place, "distance"), what, mend)


def _check_views_apart(ends: list[Ends], scenario: Scenario) -> None:
    """While the rig looks at one teacher, no other may reach into either image: one silhouette a view."""
    bearings = [teacher.bearing_deg for teacher in scenario.teachers]
    widths = [half_width_deg(one, scenario.rig) for one in ends]
    for later in range(len(bearings)):
        for earlier in range(later):
            apart = abs(bearings[later] - bearings[earlier])
            apart = min(apart, 360 - apart)
            needed = (
                scenario.rig.field_of_view_deg / 2
                + most_pan_error_deg(scenario.rig)
                + max(widths[earlier], widths[later])
            )
            if apart < needed:
                what = f"teachers {earlier} and {later}, {apart:g} degrees apart, share a view"
                mend = (
                    f"put their bearings at least {math.ceil(needed)} degrees apart, or say 'world: "
                    "{arrangement: free}'"
                )
                raise scenario.source.error(("teachers", later, "bearing_deg"), what, mend)


def _check_student_apart(student: Morphology, scenario: Scenario) -> None:
    """Wherever the rig looks, the student must not take its own body, however it turns, for a teacher.

    Teachers are in view, so that a student out of view touches none of them.
    """
    rig, centre = scenario.rig, np.array(scenario.student.position)
    radius = _radius(student)
    who = f"the student's own body, which takes up {radius:.2g} m around ({centre[0]:g}, {centre[1]:g}),"
    source = scenario.source
    position: Place = ("student", "position")
    if math.hypot(*centre) <= radius + rig.baseline / 2:
        raise source.error(position, f"{who} touches the rig's post", "move student.position behind the rig")
    if _in_view(centre, radius, rig):
        limit: Place = ("rig", "pan_limit_deg")
        place = limit if limit in source.lines and position not in source.lines else position
        mend = "move student.position behind the rig, or beyond 20 m, or lower rig.pan_limit_deg"
        raise source.error(place, f"{who} comes into the rig's view", mend)


def _in_view(centre: Vector, radius: float, rig: RigSpec) -> bool:
    """Whether a disc on the ground is seen, in width, by either camera at some pan."""
    if math.hypot(*centre) - radius > _SIGHT:
        return False
    limit, half = math.radians(rig.pan_limit_deg), math.radians(rig.field_of_view_deg) / 2
    if abs(math.atan2(*centre)) <= limit:
        return True
    for pan in (-limit, limit):  # no pan between these looks nearer to the disc
        sine, cosine = math.sin(pan), math.cos(pan)
        x, depth = centre[0] * cosine - centre[1] * sine, centre[0] * sine + centre[1] * cosine
        for eye in (-rig.baseline / 2, rig.baseline / 2):
            away, aside = math.hypot(x - eye, depth), abs(math.atan2(x - eye, depth)) - half
            if aside <= 0 or away * math.sin(min(aside, math.pi / 2)) <= radius:
                return True
    return False


def _radius(body: Morphology) -> float:
    """How far a flat body reaches from its main body's centre, whichever way it turns, in metres."""
    flat = body.poses(np.zeros(len(body.joints)))
    return max(
        math.hypot(*pose[:2, 3]) + math.hypot(*_half_sizes(body.parts[name])) for name, pose in flat.items()
    )


def _half_sizes(part: Part) -> tuple[float, float]:
    """Half of a part's length and width, caps included, in metres."""
    if part.shape == "cuboid":
        return part.size[0] / 2, part.size[1] / 2
    return (part.radius + (part.length / 2 if part.shape == "capped_cylinder" else 0)), part.radius
