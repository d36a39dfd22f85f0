"""What the student knows of its body beforehand, and the self-models it can make of that (Section 3.2).

The student knows its parts and motors but not how they are joined. A genome says so, for every limb by two genes, its
branch and its angle; the first limb, which can only hang on the main body, has an angle alone. Branch 0 is the limb
before it, 1 the one before that, and so on; the highest is the main body. For two limbs this is the paper's (alpha,
lambda, beta): limb a hangs on the main body at angle alpha, limb b on limb a (lambda = 0) or on the main body
(lambda = 1) at angle beta.
"""

from __future__ import annotations

import math
import string
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Joint, Morphology, Part, Vector
from testbed.errors import UserError

MAIN = "main"
Tree = tuple[int, ...]
"""On what each limb hangs: 0 is the main body, i + 1 is limb i."""

MOST_LIMBS = len(string.ascii_lowercase)


def limb_name(index: int) -> str:
    """``limb_a``, ``limb_b``, ... in the order of the motors."""
    return f"limb_{string.ascii_lowercase[index]}"


def hinge_name(index: int) -> str:
    """``joint_a``, ``joint_b``, ... in the order of the motors."""
    return f"joint_{string.ascii_lowercase[index]}"


@dataclass(frozen=True)
class BodyPrior:
    """Assumptions 1 to 8 of Section 3.2: the parts with shape, size, density (and friction), a motor for each limb.

    Attributes:
        main: The main body.
        limbs: The limbs, in the order of the motors that move them.
        motors: Travel, torque and speed of the motors; where they sit is unknown and left out.
    """

    main: Part
    limbs: tuple[Part, ...]
    motors: tuple[Joint, ...]

    @classmethod
    def of(cls, body: Morphology) -> BodyPrior:
        """What a student with this body knows beforehand: everything but names, topology and angles.

        Raises:
            UserError: If the body has no limb, or more than this project has letters for.
        """
        joints = tuple(body.joints.values())
        if not 1 <= len(joints) <= MOST_LIMBS:
            raise UserError(
                f"a student has 1 to {MOST_LIMBS} joints, robot '{body.name}' has {len(joints)}",
                mend="give the student a robot with joints, such as crawler",
            )
        unknown = {"parent": MAIN, "angle_deg": 0.0, "along": 1.0, "height": 0.0}
        return cls(
            main=body.parts[body.root],
            limbs=tuple(body.parts[joint.child] for joint in joints),
            motors=tuple(
                joint.model_copy(update={**unknown, "child": limb_name(index)})
                for index, joint in enumerate(joints)
            ),
        )

    @property
    def part_count(self) -> int:
        """How many parts the student has: k."""
        return 1 + len(self.limbs)

    @property
    def limits(self) -> Vector:
        """Travel of the motors, (joints, 2) rad."""
        return np.array([motor.limits for motor in self.motors])


def branch_columns(limbs: int) -> NDArray[np.int64]:
    """Which genes of a genome are branches: of (alpha, lambda, beta) the middle one."""
    return np.arange(1, 2 * limbs - 1, 2)


def branches_of(column: int) -> int:
    """How many values the branch in this column of a genome can take: any limb before it, or the main body."""
    return (column + 1) // 2 + 1


def genome_of(parents: Tree, angles: Vector) -> Vector:
    """The genome of limbs that hang on ``parents`` at ``angles`` (limbs,) rad.

    Raises:
        ValueError: If a limb hangs on a later one: no genome says that.
    """
    if any(parent > limb for limb, parent in enumerate(parents)):
        raise ValueError(f"no genome describes a limb that hangs on a later one: {parents}")
    genes = [angles[0]]
    for limb in range(1, len(parents)):
        genes += [limb - parents[limb], angles[limb]]
    return np.array(genes, dtype=float)


def tree_of(genome: Vector) -> tuple[Tree, Vector]:
    """On what each limb hangs, and the mounting angles (limbs,) rad, of a genome."""
    branches = [0, *(round(float(gene)) for gene in genome[1::2])]
    parents = tuple(limb - branch for limb, branch in enumerate(branches))
    return parents, np.array(genome[[0, *range(2, len(genome), 2)]], dtype=float)


def self_model(prior: BodyPrior, genome: Vector) -> Morphology:
    """The body that a genome describes."""
    return joined(prior, *tree_of(genome))


def joined(prior: BodyPrior, parents: Tree, angles: Vector) -> Morphology:
    """The student's parts joined: each limb to its parent, at a mounting angle (limbs,) rad."""
    joints = {
        hinge_name(limb): motor.model_copy(
            update={
                "parent": limb_name(parent - 1) if parent else MAIN,
                "angle_deg": math.remainder(math.degrees(angle), 360),
            }
        )
        for limb, (motor, parent, angle) in enumerate(zip(prior.motors, parents, angles, strict=True))
    }
    limbs = {limb_name(index): part for index, part in enumerate(prior.limbs)}
    return Morphology(name="self_model", parts={MAIN: prior.main, **limbs}, joints=joints)


def true_tree(body: Morphology) -> tuple[Tree, Vector]:
    """On what each limb of a real body hangs, and its mounting angles (limbs,) rad; limbs in motor order."""
    joints = tuple(body.joints.values())
    places = {body.root: 0, **{joint.child: limb + 1 for limb, joint in enumerate(joints)}}
    return tuple(places[joint.parent] for joint in joints), np.radians([joint.angle_deg for joint in joints])


def true_genome(body: Morphology) -> Vector:
    """The genome of a real body, for comparison outside the student.

    Raises:
        UserError: If a limb hangs on one that a later motor moves.
    """
    try:
        return genome_of(*true_tree(body))
    except ValueError:
        raise UserError(
            f"a limb of robot '{body.name}' hangs on one that a later motor moves",
            mend="list the joints from the main body outward",
        ) from None
