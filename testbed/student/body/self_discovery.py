"""Phase one, self-discovery (Section 3.2): which body would have tilted the way mine did?"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.imagination import Imagination
from testbed.student.body.self_model import BodyPrior, Tree, branch_columns, branches_of, self_model, tree_of
from testbed.student.parameters import SelfDiscoveryParameters
from testbed.student.search import HillClimber, choose_variables

_SURELY = 1 + 1e-9
"""Rounding must not decide who is worse."""


@dataclass(frozen=True)
class SelfDiscoveryRecord:
    """What the student felt and came to believe about its body.

    Attributes:
        prior: What it knew of its body beforehand.
        commands: (n, joints) random motor commands, rad.
        tilt: (n, 2) settled tilt after each, rad.
        genomes: (iterations + 1, genes) the parent after each iteration, the random start first.
        errors: (iterations + 1,) its error, Eq. 1, rad.
        believed_tilt: (iterations + 1, n, 2) the tilt that it would have felt with that body, rad.
    """

    prior: BodyPrior
    commands: Vector
    tilt: Vector
    genomes: Vector
    errors: Vector
    believed_tilt: Vector

    @property
    def genome(self) -> Vector:
        """(alpha rad, lambda, beta rad) of the final self-model; see :mod:`testbed.student.body.self_model`."""
        return np.asarray(self.genomes[-1])

    @property
    def stages(self) -> tuple[tuple[Tree, Vector], ...]:
        """On what the limbs hang and at what angles (limbs,) rad, after each iteration."""
        return tuple(tree_of(genome) for genome in self.genomes)

    @property
    def body(self) -> Morphology:
        """The final self-model."""
        return self_model(self.prior, self.genome)


def random_commands(
    prior: BodyPrior, parameters: SelfDiscoveryParameters, rng: np.random.Generator
) -> Vector:
    """Section 3.2.1: (n, joints) commands, uniform over the motors' travel, rad."""
    low, high = prior.limits.T
    return rng.uniform(low, high, (parameters.commands, len(low)))


def tilt_error(felt: Vector, believed: Vector) -> float:
    """Eq. 1: root of the summed squared differences of (n, 2) tilts, rad."""
    return float(np.sqrt(np.sum((felt - believed) ** 2)))


def evolve_self_model(
    prior: BodyPrior,
    commands: Vector,
    tilt: Vector,
    imagination: Imagination,
    parameters: SelfDiscoveryParameters,
    rng: np.random.Generator,
    progress: Callable[[int, int], None],
) -> SelfDiscoveryRecord:
    """Section 3.2.3: a hill climber over (alpha, lambda, beta), each self-model physically simulated."""
    missed, tried = np.zeros(len(commands)), np.zeros(len(commands))

    def feel(genome: Vector, best: float) -> tuple[Vector, float]:
        """How it would tilt, and Eq. 1 of it: infinite as soon as it is worse than the best.

        Eq. 1 only grows with each command, so those come first that other self-models explained worst.
        """
        felt, left = np.full_like(tilt, math.nan), best**2 * _SURELY
        order = np.argsort(-missed / np.maximum(tried, 1), kind="stable")
        rests = imagination.rests(
            self_model(prior, genome),
            commands[order],
            limit=parameters.settle_time,
            rest_speed=parameters.rest_speed,
        )
        with contextlib.closing(rests):
            for number, rest in zip(order, rests, strict=True):
                felt[number] = rest
                off = float(np.sum((tilt[number] - rest) ** 2))
                missed[number], tried[number], left = missed[number] + off, tried[number] + 1, left - off
                if left < 0:
                    return felt, math.inf
        return felt, tilt_error(tilt, felt)

    start = random_genome(len(prior.limbs), rng)
    felt, error = feel(start, math.inf)
    climber, believed = HillClimber(start, error), [felt]
    for iteration in range(parameters.iterations):
        child = mutate(climber.parent, parameters, rng)
        same = np.array_equal(child, climber.parent)  # lambda may be drawn as it was
        felt, error = (believed[-1], climber.error) if same else feel(child, climber.error)
        better = climber.tell(child, error)
        believed.append(felt if better else believed[-1])
        progress(iteration + 1, parameters.iterations)
    return SelfDiscoveryRecord(
        prior, commands, tilt, np.array(climber.parents), np.array(climber.errors), np.array(believed)
    )


def random_genome(limbs: int, rng: np.random.Generator) -> Vector:
    """A genome whose angles are uniform over the circle and whose branches are uniform over what is possible."""
    branches = set(branch_columns(limbs).tolist())
    return np.array(
        [
            float(rng.integers(branches_of(gene))) if gene in branches else rng.uniform(0, math.tau)
            for gene in range(2 * limbs - 1)
        ]
    )


def mutate(genome: Vector, parameters: SelfDiscoveryParameters, rng: np.random.Generator) -> Vector:
    """One to three variables change: angles by a Gaussian, lambda to a new random value of 0 and 1."""
    child = genome.copy()
    branches = branch_columns((len(genome) + 1) // 2)
    width = math.radians(parameters.angle_width_deg)
    for variable in choose_variables(rng, len(child), parameters.mutations_min, parameters.mutations_max):
        if variable in branches:
            child[variable] = float(rng.integers(branches_of(int(variable))))
        else:
            child[variable] += rng.normal(0.0, width)
    return child
