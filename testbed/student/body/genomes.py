"""Bodies that the student could have: the same parts, joined in any tree (Section 3.2.2, for n limbs).

The paper's genome (alpha, lambda, beta) has two limbs. Here limb i hangs on part ``parents[i]`` (0 the main body,
j + 1 limb j) at a mounting angle. Beside that stands what differs between the body that one knows and the body that
one has: what each servo adds to its command, and how much longer each limb is than believed.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from testbed.bodies.morphology import Morphology, Part, Vector
from testbed.student.body._candidates import settle_candidates
from testbed.student.body._postures import Indices
from testbed.student.body.plausibility import Felt
from testbed.student.body.self_model import BodyPrior, Tree, joined
from testbed.student.body.settling import INCREMENT, LEVEL, parents_first, shape_row
from testbed.student.parameters import PlausibilityParameters


@dataclass(frozen=True)
class Genomes:
    """Any number of bodies.

    Attributes:
        parents: (c, n) the part on which each limb hangs.
        values: (c, 3 n) mounting angles (rad), servo offsets (rad), logarithms of the limbs' length factors.
    """

    parents: Indices
    values: Vector

    def __len__(self) -> int:
        return len(self.parents)

    @property
    def limbs(self) -> int:
        """How many limbs each body has: n."""
        return int(self.parents.shape[1])

    @property
    def angles(self) -> Vector:
        """(c, n) mounting angles, rad."""
        return self.values[:, : self.limbs]

    @property
    def offsets(self) -> Vector:
        """(c, n) what the servos add to their commands, rad."""
        return self.values[:, self.limbs : 2 * self.limbs]

    @property
    def stretches(self) -> Vector:
        """(c, n) factors of the limbs' lengths."""
        return np.exp(self.values[:, 2 * self.limbs :])

    @property
    def trees(self) -> list[Tree]:
        """The parents, as tuples."""
        return [tuple(row) for row in self.parents.tolist()]

    def take(self, rows: Indices | list[int]) -> Genomes:
        """Some of the bodies."""
        return Genomes(self.parents[rows], self.values[rows])

    def repeat(self, times: int) -> Genomes:
        """Each body so many times in a row."""
        return Genomes(np.repeat(self.parents, times, axis=0), np.repeat(self.values, times, axis=0))

    @staticmethod
    def joined(*groups: Genomes) -> Genomes:
        """All bodies of several groups."""
        return Genomes(
            np.concatenate([group.parents for group in groups]),
            np.concatenate([group.values for group in groups]),
        )


class Foresight:
    """Imagines how bodies made of the student's parts would tilt, and counts how often it did.

    Args:
        prior: What the student knows of its body beforehand.

    Attributes:
        evaluations: How many bodies were imagined so far, each with however many commands.
        settles: How many commands those were in all.
    """

    def __init__(self, prior: BodyPrior) -> None:
        self.prior = prior
        speeds = np.array([motor.speed_deg for motor in prior.motors])
        self._parts = (
            np.array([(motor.along, motor.height) for motor in prior.motors]).reshape(-1, 2),
            np.array([shape_row(part) for part in (prior.main, *prior.limbs)], dtype=float),
            np.array([part.mass for part in (prior.main, *prior.limbs)]),
            speeds / speeds.max(initial=1e-9),
        )
        self.evaluations = 0

    def relive(self, genomes: Genomes, felt: Felt, beliefs: PlausibilityParameters) -> Vector:
        """(bodies, readings, 3) up directions to hold against what was felt.

        Either where each body comes to rest after each command, started flat; or, if ``beliefs.in_place``, where it
        rolls from the tilt that was felt: a body that would lie so stays.
        """
        if beliefs.in_place:
            return self.foresee(genomes, felt.commands, starts=felt.up, there=True)[0]
        return self.feel(genomes, felt.commands)

    def feel(self, genomes: Genomes, commands: Vector, gains: Vector | None = None) -> Vector:
        """The world's up direction in the root's frame, (bodies, commands, 3), settled from flat.

        Args:
            genomes: The bodies.
            commands: (m, n) motor commands, rad.
            gains: (bodies, n) how much of its command each servo follows; all of it by default.
        """
        return self.foresee(genomes, commands, gains)[0]

    def foresee(
        self,
        genomes: Genomes,
        commands: Vector,
        gains: Vector | None = None,
        *,
        starts: Vector = LEVEL,
        there: bool = False,
    ) -> tuple[Vector, Vector]:
        """As :meth:`feel`, and (bodies, commands) how hastily the body rolled: far above one where it toppled.

        Args:
            genomes: The bodies.
            commands: (m, n) motor commands, rad.
            gains: As there.
            starts: (3,) or (m, 3) the world's up in the root's frame when the body starts.
            there: Whether its joints are at their commands from the start, or flat.
        """
        ups = np.empty((len(genomes), len(commands), 3))
        haste = np.empty(ups.shape[:2])
        orders = np.array([parents_first(row) for row in genomes.parents], dtype=np.int64)
        settle_candidates(
            np.ascontiguousarray(genomes.parents),
            orders.reshape(len(genomes), -1),
            np.ascontiguousarray(genomes.angles),
            np.ascontiguousarray(genomes.offsets),
            np.ascontiguousarray(genomes.stretches),
            np.ones(genomes.parents.shape) if gains is None else gains,
            *self._parts,
            np.ascontiguousarray(commands, dtype=float),
            INCREMENT,
            np.array(np.broadcast_to(starts, (len(commands), 3)), order="C"),
            there,
            ups,
            haste,
        )
        self.evaluations += len(genomes)
        return ups, haste


def body_of(prior: BodyPrior, parents: Tree, angles: Vector, stretches: Vector) -> Morphology:
    """The body that a genome describes, without its servo offsets, which are no part of a body.

    Args:
        prior: The parts and motors.
        parents: On which part each limb hangs.
        angles: (n,) mounting angles, rad.
        stretches: (n,) factors of the limbs' lengths.
    """
    limbs = tuple(stretched(part, float(factor)) for part, factor in zip(prior.limbs, stretches, strict=True))
    return joined(replace(prior, limbs=limbs), parents, angles)


def stretched(part: Part, factor: float) -> Part:
    """A part so many times as long along its x."""
    if part.shape == "cuboid":
        return part.model_copy(update={"size": (part.size[0] * factor, *part.size[1:])})
    if part.shape == "capped_cylinder":
        return part.model_copy(update={"length": part.length * factor})
    return part.model_copy(update={"radius": part.radius * factor})


def is_tree(parents: Tree) -> bool:
    """Whether every limb leads back to the main body."""
    for limb in range(len(parents)):
        here, steps = limb + 1, 0
        while here and steps <= len(parents):
            here, steps = parents[here - 1], steps + 1
        if here:
            return False
    return True


def all_trees(limbs: int) -> list[Tree]:
    """Every way to join them: (n + 1)^(n - 1), 3 for two limbs and 16 for three."""
    return [tree for tree in itertools.product(range(limbs + 1), repeat=limbs) if is_tree(tree)]


def random_tree(limbs: int, rng: np.random.Generator, *, outward: bool = False) -> Tree:
    """Limbs are hung one by one, in random order or in that of the motors, each on anything that hangs already."""
    parents = [0] * limbs
    placed = [0]
    for limb in range(limbs) if outward else rng.permutation(limbs).tolist():
        parents[limb] = placed[int(rng.integers(len(placed)))]
        placed.append(limb + 1)
    return tuple(parents)
