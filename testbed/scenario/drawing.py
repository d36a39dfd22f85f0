"""The concrete scenario of one trial: every distribution drawn, every random gait and body written out.

What is drawn follows from the scenario's seed, the trial and the place in the scenario alone. So a trial is the same
whoever runs it and whenever, and two cells of a scenario draw alike whatever they have in common.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbed.documents import Document, Source, validate
from testbed.errors import UserError
from testbed.scenario.bodies import BodyPlan, drawn_tree
from testbed.scenario.specs import Scenario
from testbed.scenario.student import DamageSpec, Deviation, RealityGap, StudentSpec
from testbed.scenario.teacher import FARTHEST, GaitSpec, Harmonic, JointWave, RandomWaves, TeacherSpec
from testbed.scenario.variation import Choice, Place, chance, corners, place_of, realised, replaced, value_of
from testbed.scenario.view import nearest_distance

if TYPE_CHECKING:
    from testbed.bodies.morphology import Joint, Morphology

_BODILY = ("robot", "scale", "limb_scale", "distance")
_SMALLEST_FACTOR = 0.2
_ROUNDING_DEG = 0.004  # angles are rounded to thousandths, so that reports can be read


def drawn(scenario: Scenario, trial: int) -> Scenario:
    """The scenario of one trial, without anything left to chance; itself if it leaves nothing to chance.

    A teacher whose body or distance is drawn (or with ``fit: true``) is moved back to the nearest distance at which
    it fits in view, where it would not at the distance drawn.

    Args:
        scenario: A scenario without cells, see :func:`testbed.scenario.in_cell`.
        trial: Which trial.

    Raises:
        UserError: If what is drawn is impossible.
    """
    data = scenario.template
    for place, raw in scenario.variation.items():
        rng = chance(scenario.seed, trial, place_of(place))
        data = replaced(data, place_of(place), realised(raw, rng))
    return _written_out(scenario, data, trial)


def extremes(scenario: Scenario) -> Iterator[Scenario]:
    """Concrete scenarios at either end of every distribution and with every option of every choice, one by one."""
    if not scenario.variation:
        yield _written_out(scenario, scenario.template, 0)
    for corner in corners({**scenario.template, "cells": {}}):
        yield _written_out(scenario, corner, 0)


def check_ends(scenario: Scenario) -> None:
    """See that every distribution's ends are values that may stand in its place; bodies are not looked at.

    Raises:
        UserError: If one may not.
    """
    for corner in corners({**scenario.template, "cells": {}}):
        validate(Scenario, Document(corner, scenario.source))


def body_at(owner: StudentSpec | TeacherSpec, place: Place, source: Source) -> Morphology:
    """The body of whoever stands at a place in the scenario.

    Raises:
        UserError: If there is no such robot, with its line in the scenario's file, or its description is wrong.
    """
    try:
        return owner.body()
    except UserError as error:
        if error.file is not None and error.line is not None:
            raise  # the mistake is inside the robot's own file
        what = error.what if error.file is None else f"{Path(error.file).name}: {error.what}"
        raise source.error(place, what, error.mend) from None


def _written_out(scenario: Scenario, data: dict[str, Any], trial: int) -> Scenario:
    """The scenario with data that hold no distributions, its random gaits and bodies drawn."""
    concrete = scenario
    if scenario.variation:
        concrete = validate(Scenario, Document({**data, "cells": {}}, scenario.source))
        concrete._source = scenario.source
    student = _drawn_student(concrete, trial)
    teachers = tuple(
        _drawn_teacher(concrete, index, trial, fits=_bodily(scenario, index))
        for index in range(len(concrete.teachers))
    )
    if concrete is scenario and student is scenario.student and teachers == scenario.teachers:
        return scenario
    concrete = concrete.model_copy(update={"student": student, "teachers": teachers})
    concrete._source = scenario.source
    return concrete


def _bodily(scenario: Scenario, index: int) -> bool:
    """Whether a teacher's body or distance is drawn."""
    robot = scenario.teachers[index].robot if index < len(scenario.teachers) else None
    if isinstance(robot, BodyPlan) and robot.random is not None:
        return True
    places = [place_of(place) for place in scenario.variation]
    return any(
        place in ((), ("teachers",), ("teachers", index))
        or (place[:2] == ("teachers", index) and place[2] in _BODILY)
        for place in places
    )


def _drawn_teacher(scenario: Scenario, index: int, trial: int, *, fits: bool) -> TeacherSpec:
    teacher, seed, source = scenario.teachers[index], scenario.seed, scenario.source
    place: Place = ("teachers", index)
    update: dict[str, object] = {}
    if isinstance(teacher.robot, BodyPlan) and teacher.robot.random is not None:
        robot = drawn_tree(teacher.robot, chance(seed, trial, (*place, "robot", "random")))
        update["robot"] = robot
        teacher = teacher.model_copy(update=update)
    moved_back = teacher.fit or (teacher.fit is None and fits)
    if not moved_back and teacher.gait.kind != "random":
        return teacher
    body = body_at(teacher, (*place, "robot"), source)
    if teacher.gait.kind == "random":
        rng = chance(seed, trial, (*place, "gait", "random"))
        update["gait"] = drawn_gait(teacher.gait, body, rng)
    if moved_back:
        nearest = math.ceil(nearest_distance(body, teacher, scenario.rig) * 1e3) / 1e3
        if nearest > FARTHEST:
            what = f"robot '{body.name}', this large, fits in view only from {nearest:g} m on"
            raise source.error((*place, "scale"), what, f"make it smaller: it must fit at {FARTHEST:g} m")
        if teacher.distance < nearest:
            update["distance"] = nearest
    return teacher.model_copy(update=update) if update else scenario.teachers[index]


def drawn_gait(gait: GaitSpec, body: Morphology, rng: np.random.Generator) -> GaitSpec:
    """A random gait of a body: cyclic, or a push if it has no joints.

    Period, wave form and speed are drawn first and whatever the body, then each joint's motion, so that bodies with
    the same first joints move these alike.
    """
    ranges = gait.random
    period, speed = round(value_of(ranges.period, rng), 4), round(value_of(ranges.speed, rng), 4)
    form = ranges.wave_form.draw(rng) if isinstance(ranges.wave_form, Choice) else ranges.wave_form
    common = {"period": period, "random": RandomWaves()}
    if not body.joints:
        return gait.model_copy(update={**common, "kind": "push", "speed": speed})
    waves = {name: _drawn_wave(joint, ranges, rng) for name, joint in body.joints.items()}
    return gait.model_copy(update={**common, "kind": "cyclic", "joints": waves, "wave_form": form})


def _drawn_wave(joint: Joint, ranges: RandomWaves, rng: np.random.Generator) -> JointWave:
    amplitude, place = value_of(ranges.amplitude_deg, rng), value_of(ranges.centre, rng)
    phase, share = value_of(ranges.phase_deg, rng), abs(value_of(ranges.second_harmonic, rng))
    second = value_of(ranges.phase_deg, rng)
    low, high = joint.limits_deg
    middle, travel = (low + high) / 2, (high - low) / 2
    amplitude = round(min(amplitude, max(0.0, travel - _ROUNDING_DEG) / (1 + share)), 3)
    swing = amplitude * (1 + share)
    return JointWave(
        centre_deg=round(middle + place * max(0.0, travel - _ROUNDING_DEG - swing), 3),
        amplitude_deg=amplitude,
        phase_deg=round(phase, 2),
        harmonics=(
            (Harmonic(amplitude_deg=round(share * amplitude, 3), phase_deg=round(second, 2)),)
            if share
            else ()
        ),
    )


def _drawn_student(scenario: Scenario, trial: int) -> StudentSpec:
    student, seed = scenario.student, scenario.seed
    update: dict[str, object] = {}
    if isinstance(student.robot, BodyPlan) and student.robot.random is not None:
        update["robot"] = drawn_tree(student.robot, chance(seed, trial, ("student", "robot", "random")))
        student = student.model_copy(update=update)
    if student.reality_gap is None and student.damage is None:
        return student
    body = body_at(student, ("student", "robot"), scenario.source)
    if student.reality_gap is not None:
        update["reality_gap"] = _drawn_gap(student.reality_gap, body, seed, trial)
    if student.damage is not None:
        rng = chance(seed, trial, ("student", "damage", "random"))
        update["damage"] = _drawn_damage(student.damage, body, rng)
    return student.model_copy(update=update) if update else student


def _drawn_gap(gap: RealityGap, body: Morphology, seed: int, trial: int) -> RealityGap:
    joints, parts = len(body.joints), len(body.parts)

    def values(name: str, count: int, around: float) -> tuple[float, ...]:
        spread: Deviation = getattr(gap, name)
        if isinstance(spread, tuple):
            return spread
        rng = chance(seed, trial, ("student", "reality_gap", name))
        if isinstance(spread, int | float):
            deviations = [spread * float(rng.standard_normal()) for _ in range(count)]
        else:
            deviations = [value_of(spread, rng) for _ in range(count)]
        drawn_values = (around + deviation for deviation in deviations)
        return tuple(round(max(value, _SMALLEST_FACTOR) if around else value, 5) for value in drawn_values)

    return RealityGap(
        servo_offset_deg=values("servo_offset_deg", joints, 0.0),
        servo_lag=tuple(map(abs, values("servo_lag", joints, 0.0))),
        limb_length=values("limb_length", joints, 1.0),
        density=values("density", parts, 1.0),
        friction=values("friction", parts, 1.0),
        tilt_bias_deg=values("tilt_bias_deg", 2, 0.0),
    )


def _drawn_damage(damage: DamageSpec, body: Morphology, rng: np.random.Generator) -> DamageSpec:
    names = list(body.joints)
    if not names:
        return damage
    joint = names[int(rng.integers(len(names)))]
    update = {}
    if damage.limb_lost == "random":
        update["limb_lost"] = body.joints[joint].child
    if damage.joint_locked == "random":
        update["joint_locked"] = joint
    return damage.model_copy(update=update) if update else damage
