"""Phase four of ``like_me``: the controller moves the student for as long as one likes. An extension of Section 3.4.

The rolls of the teacher's rhythm are fed to the controller at the control rate. A servo lags behind its command and
so makes swift swings smaller; the student knows its servos from its imagination and asks for what makes up for it.
The gait begins from lying flat with a slow turn to its first posture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.imagination import Imagination, Rehearsal
from testbed.student.body.settling import Settler
from testbed.student.motion import TeacherMotion
from testbed.student.moving.imitation import controller
from testbed.student.moving.readings import length_ratios, wrapped
from testbed.student.moving.rolls import headings, roll_of, view_of
from testbed.student.parameters import PerformingParameters
from testbed.student.search import choose_variables
from testbed.vision.primitives import X

if TYPE_CHECKING:
    from testbed.student.moving.rehearsal import RehearsalRecord


def prepare(
    record: RehearsalRecord,
    motion: TeacherMotion,
    body: Morphology,
    mind: Imagination,
    control_step: float,
    parameters: PerformingParameters,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> RehearsalRecord:
    """All that the student does between its verdict and its performance: feel its servos lag, then practise.

    Args:
        record: What came of imitation in the mind.
        motion: What was seen of the teacher.
        body: The student's self-model.
        mind: The physical imagination.
        control_step: s.
        parameters: What the paper leaves open.
        rng: Source of chance.
        progress: Called with (done, total).

    Returns:
        The record, ready for :meth:`RehearsalRecord.performance`.
    """
    with mind.imagine(body) as rehearsal:
        lag = servo_lag(rehearsal, playback(record, control_step, parameters), control_step, parameters)
        travel = travel_seen(motion, record, body)
        led = replace(record, lag=lag)
        return practise(led, body, rehearsal, travel, control_step, parameters, rng, progress)


def playback(record: RehearsalRecord, control_step: float, parameters: PerformingParameters) -> Vector:
    """Motor commands that perform what was rehearsed: (steps, joints) rad, one a control step.

    Args:
        record: What came of imitation in the mind.
        control_step: s.
        parameters: How long, and how it begins.
    """
    seconds = min(duration(record, parameters), parameters.seconds)
    times = np.asarray(record.rhythm.start + control_step * np.arange(max(1, round(seconds / control_step))))
    motion = commands_at(record, times)
    rise = np.linspace(0.0, math.pi, ramp_steps(parameters, control_step) + 1)[1:-1]
    return np.concatenate([np.outer((1 - np.cos(rise)) / 2, motion[0]), motion])


def ramp_steps(parameters: PerformingParameters, control_step: float) -> int:
    """How many control steps the turn to the first posture takes."""
    return max(1, round(parameters.ramp / control_step))


def duration(record: RehearsalRecord, parameters: PerformingParameters) -> float:
    """How long (s) the motion lasts that is to be performed, without the turn to its first posture."""
    if record.rhythm.period is None:
        return float(record.times[-1] - record.times[0])
    return parameters.cycles * record.rhythm.period


def commands_at(record: RehearsalRecord, times: Vector) -> Vector:
    """The controller's commands (n, joints) at times (n,), s, rad, led by what a lagging servo needs.

    A servo that follows with a speed in proportion to what is missing arrives at the wanted angle if it is asked
    for the angle plus its lag times the angle's speed.
    """
    behind, now, ahead = (
        controller(record.performed, record.rhythm.at(times + shift), record.limits)
        for shift in (-record.lag / 2, 0, record.lag / 2)
    )
    return np.asarray(np.clip(now + (ahead - behind), *record.limits.T))


def servo_lag(
    rehearsal: Rehearsal, commands: Vector, control_step: float, parameters: PerformingParameters
) -> float:
    """How far (s) the imagined servos are behind commands (steps, joints): the delay that explains them best."""
    _, joints = rehearsal.move(commands)
    steps = np.arange(len(commands))
    tried = np.arange(0.0, parameters.longest_lag, control_step / 8) / control_step
    errors = []
    for delay in tried:
        late = np.stack([np.interp(steps - delay, steps, channel) for channel in commands.T], axis=1)
        errors.append(float(np.sum((late - joints)[len(steps) // 4 :] ** 2)))
    return float(tried[int(np.argmin(errors))] * control_step)


def travel_seen(motion: TeacherMotion, record: RehearsalRecord, body: Morphology) -> float:
    """How far (m) the teacher's main body came in a period, towards where the student's own front would be.

    Measured in the image plane, on the scale of the student's body: by the ratio of the lengths of parts. Nan for
    a motion without a rhythm.
    """
    period = record.rhythm.period
    if period is None:
        return math.nan
    x, times = motion.parts[:, record.order[0], X], motion.times
    later = times[times + period <= times[-1]]
    gone = float(np.median(np.interp(later + period, times, x) - np.interp(later, times, x)))
    return (-gone if record.mirrored else gone) / size_seen(motion, record, body)


def size_seen(motion: TeacherMotion, record: RehearsalRecord, body: Morphology) -> float:
    """How many times as large as the student the teacher is: the median ratio of the lengths of their parts."""
    return float(np.median(length_ratios(body, motion.parts[:, record.order])))


def practise(
    record: RehearsalRecord,
    body: Morphology,
    rehearsal: Rehearsal,
    travel: float,
    control_step: float,
    parameters: PerformingParameters,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> RehearsalRecord:
    """Go on with the hill climber in the physical imagination, where feet slip and swings have weight.

    What is made small is Eq. 5 and, if the teacher came forward, the difference of the distances travelled. How the
    body rolls is foreseen quasi-statically, thirty times as fast: a controller whose rolls alone are too far off is not
    imagined. That is believed as far as it was right about the best so far. Measured on seeds 7 and 777: of 2040
    mutations (crawlers, random bodies, quadrupeds) 492 are not imagined, and none of the 255 successes is lost.

    Args:
        record: What came of imitation in the mind.
        body: The student's self-model.
        rehearsal: That body in the imagination.
        travel: How far the teacher came in a period, on the student's scale, m; nan if unknown.
        control_step: s.
        parameters: What the paper leaves open.
        rng: Source of chance.
        progress: Called with (done, total).

    Returns:
        The record with what it performs now.
    """
    period = record.rhythm.period
    if period is None or not parameters.practice:
        return record
    short = parameters.model_copy(update={"cycles": parameters.practice_cycles, "seconds": math.inf})
    skipped = ramp_steps(short, control_step) - 1
    right = view_of(body)[0]
    size = max(part.length_along_x for part in body.parts.values())

    settler = Settler(body)

    def rolled(bases: Vector, joints: Vector) -> float:
        bases, joints = bases[skipped:], joints[skipped:]
        times = np.asarray(record.rhythm.start + control_step * np.arange(len(bases)))
        wanted = record.rhythm.at(times)[:, record.order]
        off = wrapped(roll_of(headings(body, bases, joints), right) - wanted)
        return (float(np.sqrt(np.mean(off**2))) / math.radians(parameters.roll_tolerance_deg)) ** 2

    def costs(weights: Vector, best: float, doubt: float) -> tuple[float, float]:
        commands = playback(replace(record, performed=weights), control_step, short)
        foreseen = rolled(*settler.follow(commands, rehearsal.servos))
        if foreseen - doubt >= best:
            return math.inf, doubt
        bases, joints = rehearsal.move(commands)
        rolls = rolled(bases, joints)
        doubt = abs(foreseen - rolls)
        if math.isnan(travel):
            return rolls, doubt
        gone = float((bases[-1, :3] - bases[skipped, :3]) @ right) / parameters.practice_cycles
        missing = (gone - travel) / (abs(travel) + 0.02 * size) / parameters.travel_tolerance
        return rolls + missing**2, doubt

    parent, width = record.performed, parameters.practice_width
    best, doubt = costs(parent, math.inf, 0.0)
    for number in range(parameters.practice):
        child = parent.copy()
        chosen = choose_variables(rng, child.size, 1, 3)
        child.reshape(-1)[chosen.astype(int)] += rng.normal(0.0, width, len(chosen))
        left, doubted = costs(child, best, doubt)
        width *= 1.5 if left < best else 0.9
        if left < best:
            parent, best, doubt = child, left, doubted
        progress(number + 1, parameters.practice)
    return replace(record, performed=parent)
