"""Phase three of ``like_me``, imitation in the mind: can I move the way that teacher did? An extension.

The controller is the paper's: one layer from k rolls to n motors (Section 3.4.1). What is new is how it is found and
judged. A closed form gives a good start: rolls of joined parts tell the angle of the joint between them, and a
logistic unit is fitted to each motor's. From there and from random weights damped least squares, and at last a hill
climber, lower Eq. 5 on the response of the self-model, which a quasi-static solver computes a hundred times faster
than a simulation. The final controller is tried once in the physical imagination.

The verdict asks how much of the motion is the student's own: of the whole, and of the angle at every joint, beyond
what a body that stands still explains. Whoever holds a joint still that the student has does not show that it is a
joint, and whoever is heavier at one end tips over at other angles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.imagination import Imagination
from testbed.student.body.settling import Settler
from testbed.student.motion import TeacherMotion
from testbed.student.moving.harmonics import Harmonics, fit_harmonics, unwrapped
from testbed.student.moving.imitation import controller
from testbed.student.moving.performing import playback
from testbed.student.moving.readings import Reading, readings, wrapped
from testbed.student.moving.rehearsal_search import (
    climb,
    damped_least_squares,
    differences,
    joint_angles,
    logistic_start,
)
from testbed.student.moving.rolls import headings, roll_of, view_of
from testbed.student.parameters import PerformingParameters, RehearsalParameters
from testbed.vision.primitives import OMEGA

_NUDGE = 1e-3  # rad; of a joint, to see how the rolls follow


@dataclass(frozen=True)
class RehearsalRecord:
    """What came of trying to move like one teacher: the fields of ``ImitationRecord``, and what is new.

    Attributes:
        teacher_rolls: (samples, k) rolls of the teacher's objects, rad, as fed to the network.
        order: (k,) the object that corresponds to each part of the student.
        weights: (iterations + 1, joints, k) the best network so far after each iteration, a random start first.
        errors: (iterations + 1,) its error, Eq. 5, rad.
        responses: (iterations + 1, samples, k) rolls of the self-model under it, rad; what did not change shares
            memory.
        limits: (joints, 2) travel of the motors that the outputs are scaled to, rad.
        times: (samples,) moments of the samples, s.
        rhythm: The teacher's rolls at any time, as fed to the network.
        mirrored: Whether the teacher was taken for one seen from its other side.
        misplaced: How far its parts are from where the student's would be, see ``readings.misplacement``.
        r2: Share of the motion that the controller reproduces beyond the best static posture, at most 1.
        joint_r2: (joints,) the same of the angle at each joint; one that stands still has about 0.
        imagined_error: Eq. 5 per sample and part of the final controller in the physical imagination, rms rad; nan
            if it was not tried there.
        performed: (joints, k) the network that moves the student: the final one, until it has practised.
        lag: Of the student's servos, s; 0 until it has practised.
        score: How much of the teacher's motion is the student's own, from -1 to 1, the higher the more like it: the
            smallest of ``r2`` and ``joint_r2``, less what is misplaced and what the teacher model leaves unexplained.
    """

    teacher_rolls: Vector
    order: NDArray[np.int64]
    weights: Vector
    errors: Vector
    responses: tuple[Vector, ...]
    limits: Vector
    times: Vector
    rhythm: Harmonics
    mirrored: bool
    misplaced: float
    r2: float
    joint_r2: Vector
    imagined_error: float
    performed: Vector
    lag: float
    score: float

    @property
    def commands(self) -> Vector:
        """(samples, joints) motor commands of the final controller at the moments of the samples, rad."""
        return controller(self.weights[-1], self.teacher_rolls, self.limits)

    def performance(self, control_step: float, parameters: PerformingParameters | None = None) -> Vector:
        """(steps, joints) motor commands, one a control step (s), that imitate the teacher, rad."""
        return playback(self, control_step, parameters or PerformingParameters())

    @property
    def rms(self) -> float:
        """Eq. 5 of the final controller per sample and part, rad."""
        return float(self.errors[-1]) / math.sqrt(self.teacher_rolls.size)


def rehearse(
    body: Morphology,
    motion: TeacherMotion,
    mind: Imagination | None,
    parameters: RehearsalParameters,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    control_step: float = 1 / 60,
    explained: float = 1.0,
    main_known: bool = True,
) -> RehearsalRecord:
    """Find the controller that lets the self-model move most like the teacher, and say how much like it that is.

    Args:
        body: The student's self-model.
        motion: How the teacher's parts moved; as many as the student has.
        mind: The physical imagination in which the final controller is tried; None to leave that out.
        parameters: What the paper leaves open.
        rng: Source of chance.
        progress: Called with (done, total).
        control_step: Seconds between two motor commands in the imagination.
        explained: Share of what was seen that the teacher model accounts for, if that is known.
        main_known: Whether the first object is the main body; otherwise any may be.

    Raises:
        ValueError: If the teacher model has another number of parts than the student.
    """
    if motion.parts.shape[1] != len(body.parts):
        raise ValueError(f"a body of {len(body.parts)} parts cannot imitate {motion.parts.shape[1]} objects")
    rhythm = fit_harmonics(motion.times, unwrapped(motion.parts[:, :, OMEGA]), parameters.harmonics)
    times = np.linspace(motion.times[0], motion.times[-1], parameters.samples)
    found = readings(body, motion, rhythm, parameters.poses, parameters.proportions, main_known)
    trials = [_Trial(reading, times) for reading in found[: parameters.readings]]
    closed = [trial.start() for trial in trials]
    lefts = [trial.residual(start) for trial, start in zip(trials, closed, strict=True)]
    best = int(np.argmin([left @ left for left in lefts]))
    trial, history = trials[best], _History(trials[best])

    reach, size = parameters.initial_weight, closed[best].size
    starts = [rng.uniform(-reach, reach, size) for _ in range(parameters.restarts - 1)]
    starts.insert(1, closed[best])
    for number, start in enumerate(starts):
        history.told(start, trial.residual(start))
        damped_least_squares(trial.residual, trial.jacobian, start, parameters.steps, history.told)
        progress(number + 1, len(starts) + 1)
    width = parameters.weight_width
    climb(trial.residual, history.weights[-1], parameters.climbing, width, rng, history.told)
    progress(len(starts) + 1, len(starts) + 1)

    imagined = math.nan
    if mind is not None:
        with mind.imagine(trial.body) as rehearsal:
            when = np.arange(times[0], times[-1], control_step)
            fed = trial.reading.rhythm.at(when)
            weights = history.weights[-1].reshape(trial.shape)
            bases, joints = rehearsal.move(controller(weights, fed, trial.limits))
            off = wrapped(trial.rolls(bases, joints) - fed[:, trial.reading.order])
            imagined = float(np.sqrt(np.mean(off**2)))
    return _record(trial, history, imagined, explained, parameters)


class _Trial:
    """The self-model tried under controllers, against one reading of the teacher."""

    def __init__(self, reading: Reading, times: Vector) -> None:
        self.body, self.reading, self.times = reading.body, reading, times
        self._settler, self._right = Settler(reading.body), view_of(reading.body)[0]
        self.fed = reading.rhythm.at(times)
        self.wanted, self.limits = self.fed[:, reading.order], self.body.limits
        self.shape = (len(self.body.joints), len(self.body.parts))

    def start(self) -> Vector:
        """Weights in closed form."""
        return logistic_start(self.fed, joint_angles(self.body, self.wanted), self.limits).ravel()

    def rolls(self, bases: Vector, joints: Vector) -> Vector:
        """(n, k) rolls of the body in these poses, rad."""
        return roll_of(headings(self.body, bases, joints), self._right)

    def residual(self, weights: Vector) -> Vector:
        """What Eq. 5 sums the squares of, (samples x k,) rad, each within half a turn."""
        return self._missed(controller(weights.reshape(self.shape), self.fed, self.limits))

    def jacobian(self, weights: Vector, now: Vector) -> Vector:
        """How the residuals follow the weights: the rolls follow a joint, the joint follows its weights."""
        targets = controller(weights.reshape(self.shape), self.fed, self.limits)
        share = expit(self.fed @ weights.reshape(self.shape).T)
        columns = np.empty((len(now), *self.shape))
        for joint, (low, high) in enumerate(self.limits):
            nudged = targets.copy()
            nudged[:, joint] += _NUDGE
            follows = (self._missed(nudged) - now).reshape(self.wanted.shape) / _NUDGE
            gain = (high - low) * (share * (1 - share))[:, joint, None] * self.fed
            columns[:, joint] = (follows[:, :, None] * gain[:, None, :]).reshape(len(now), -1)
        return columns.reshape(len(now), -1)

    def static(self) -> float:
        """Sum of squares of the best posture that does not move."""

        def missed(posture: Vector) -> Vector:
            held = posture.clip(*self.limits.T)[None]
            return wrapped(self.rolls(self._settler.settle(held), held) - self.wanted).ravel()

        start = joint_angles(self.body, self.wanted).mean(axis=0).clip(*self.limits.T)
        _, left = damped_least_squares(missed, differences(missed), start, 8)
        return float(left @ left)

    def _missed(self, targets: Vector) -> Vector:
        return wrapped(self.rolls(*self._settler.follow(targets)) - self.wanted).ravel()


class _History:
    """The best weights after each that were tried."""

    def __init__(self, trial: _Trial) -> None:
        self._wanted = trial.wanted
        self.weights: list[Vector] = []
        self.errors: list[float] = []
        self.responses: list[Vector] = []

    def told(self, weights: Vector, residual: Vector) -> None:
        """Take note of one more."""
        error = float(np.linalg.norm(residual))
        better = not self.errors or error < self.errors[-1]
        self.errors.append(error if better else self.errors[-1])
        self.weights.append(weights if better else self.weights[-1])
        response = self._wanted + residual.reshape(self._wanted.shape) if better else self.responses[-1]
        self.responses.append(response)


def _record(
    trial: _Trial, history: _History, imagined: float, explained: float, parameters: RehearsalParameters
) -> RehearsalRecord:
    response, wanted, body = history.responses[-1], trial.wanted, trial.body
    static, left = trial.static(), history.errors[-1] ** 2
    still = math.radians(parameters.still_deg) ** 2 * len(wanted)

    def share(believed: Vector, seen: Vector) -> float:
        moved = float(np.sum((seen - seen.mean()) ** 2))
        return (moved - float(np.sum((believed - seen) ** 2))) / (moved + still)

    names = list(body.parts)
    joints = [(names.index(joint.child), names.index(joint.parent)) for joint in body.joints.values()]
    r2 = (static - left) / (static + still)
    joint_r2 = [share(response[:, c] - response[:, p], wanted[:, c] - wanted[:, p]) for c, p in joints]
    missing = parameters.misplacement_weight * trial.reading.misplaced
    missing += parameters.unexplained_weight * (1 - explained)
    return RehearsalRecord(
        teacher_rolls=trial.fed,
        order=trial.reading.order,
        weights=np.array(history.weights).reshape(-1, *trial.shape),
        errors=np.array(history.errors),
        responses=tuple(history.responses),
        limits=trial.limits,
        times=trial.times,
        rhythm=trial.reading.rhythm,
        mirrored=trial.reading.mirrored,
        misplaced=trial.reading.misplaced,
        r2=r2,
        joint_r2=np.array(joint_r2),
        imagined_error=imagined,
        performed=history.weights[-1].reshape(trial.shape),
        lag=0.0,
        score=max(-1.0, min([r2, *joint_r2]) - missing),
    )
