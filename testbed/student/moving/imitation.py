"""Phase three, imitation in the mind (Section 3.4): can my self-model move the way that teacher did?"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import expit

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.imagination import Imagination
from testbed.student.moving.beaten import Beaten
from testbed.student.moving.rolls import headings, read_rolls, roll_of, view_of
from testbed.student.parameters import ImitationParameters
from testbed.student.search import HillClimber, choose_variables
from testbed.vision.primitives import OMEGA, X, Y


@dataclass(frozen=True)
class ImitationRecord:
    """What came of trying to move like one teacher.

    Attributes:
        teacher_rolls: (samples, k) rolls of the teacher model's objects, rad, as fed to the network.
        order: (k,) the object that corresponds to each part of the student.
        weights: (iterations + 1, joints, k) the parent network after each iteration, the random start first.
        errors: (iterations + 1,) its error, Eq. 5, rad.
        responses: (iterations + 1, samples, k) rolls of the self-model under it, rad; parents that did not change
            share memory.
        limits: (joints, 2) travel of the motors that the outputs are scaled to, rad.
    """

    teacher_rolls: Vector
    order: NDArray[np.int64]
    weights: Vector
    errors: Vector
    responses: tuple[Vector, ...]
    limits: Vector

    @property
    def commands(self) -> Vector:
        """(samples, joints) motor commands of the final controller, rad."""
        return controller(self.weights[-1], self.teacher_rolls, self.limits)


def controller(weights: Vector, rolls: Vector, limits: Vector) -> Vector:
    """Section 3.4.1: a single layer from k rolls (samples, k) to joint commands (samples, joints), rad.

    The weighted sum passes a logistic function, whose (0, 1) is scaled linearly to each joint's travel.
    """
    low, high = limits.T
    return np.asarray(low + (high - low) * expit(rolls @ weights.T))


def imitation_error(teacher_rolls: Vector, order: NDArray[np.int64], response: Vector) -> float:
    """Eq. 5: root of the summed squared differences of rolls (samples, k) after reordering the teacher's, rad."""
    return float(np.sqrt(np.sum((teacher_rolls[:, order] - response) ** 2)))


def correspondence(own: Vector, theirs: Vector) -> NDArray[np.int64]:
    """Section 3.4.2: which teacher object corresponds to which part, by proximity of normalised positions.

    Args:
        own: (k, 2) positions of the self-model's parts, main body at the left and l_b at the right.
        theirs: (k, 2) positions of the teacher model's objects.

    Returns:
        (k,) for each part the index of its object; together the Euclidean distances are smallest.
    """
    gaps = normalised(own)[:, None] - normalised(theirs)[None]
    _, order = linear_sum_assignment(np.linalg.norm(gaps, axis=2))
    return np.asarray(order, dtype=np.int64)


def normalised(places: Vector) -> Vector:
    """Positions (k, 2) moved to start at zero and scaled, both axes alike, to a greatest extent of one."""
    moved = places - places.min(axis=0)
    return np.asarray(moved / max(float(moved.max()), 1e-9))


def evolve_controller(
    body: Morphology,
    history: Vector,
    imagination: Imagination,
    parameters: ImitationParameters,
    rng: np.random.Generator,
    progress: Callable[[int, int], None],
) -> ImitationRecord:
    """Section 3.4.2: a hill climber over the weights of a network that moves the self-model.

    Args:
        body: The student's self-model.
        history: (samples, k, 8) parameter history of the teacher model.
        imagination: Where the self-model is simulated.
        parameters: What the paper leaves open.
        rng: Source of chance.
        progress: Called with (done, total).
    """
    right, places = view_of(body)
    rolls = read_rolls(history[:, :, OMEGA], parameters.roll_reading)
    theirs = history[:, :, [X, Y]]
    order = correspondence(places, theirs[-1] if parameters.positions == "last" else theirs.mean(axis=0))
    limits, shape = body.limits, (len(body.joints), rolls.shape[1])
    beaten = Beaten(body, right, rolls[:, order], parameters.roll_reading)

    with imagination.imagine(body) as rehearsal:

        def respond(weights: Vector, best: float) -> tuple[Vector, float]:
            commands = controller(weights.reshape(shape), rolls, limits)
            bases, joints = rehearsal.move(commands, beaten.by(best))
            if np.isnan(joints[-1]).any():
                return joints, math.inf  # it was not seen to its end
            response = read_rolls(roll_of(headings(body, bases, joints), right), parameters.roll_reading)
            return response, imitation_error(rolls, order, response)

        start = rng.uniform(-parameters.initial_weight, parameters.initial_weight, shape).ravel()
        response, error = respond(start, math.inf)
        climber, responses = HillClimber(start, error), [response]
        for iteration in range(parameters.iterations):
            child = mutate(climber.parent, parameters, rng)
            response, error = respond(child, climber.error)
            better = climber.tell(child, error)
            responses.append(response if better else responses[-1])
            progress(iteration + 1, parameters.iterations)
    weights = np.array(climber.parents).reshape(-1, *shape)
    return ImitationRecord(rolls, order, weights, np.array(climber.errors), tuple(responses), limits)


def mutate(weights: Vector, parameters: ImitationParameters, rng: np.random.Generator) -> Vector:
    """One to three weights change by a Gaussian."""
    child = weights.copy()
    chosen = choose_variables(rng, child.size, parameters.mutations_min, parameters.mutations_max)
    child[chosen] += rng.normal(0.0, parameters.weight_width, len(chosen))
    return child
