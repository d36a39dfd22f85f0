"""What the student knows of its body beforehand, and the self-models it can make of that (Section 3.2).

The student knows its parts and motors but not how they are joined. A genome (alpha, lambda, beta) says so: limb a
hangs on the main body at angle alpha, limb b on limb a (lambda = 0) or on the main body (lambda = 1) at angle beta.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.errors import UserError
from testbed.morphology import Joint, Morphology, Part, Vector

MAIN, LIMBS, HINGES = "main", ("limb_a", "limb_b"), ("joint_a", "joint_b")


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
            UserError: If the body has other than two limbs, which the paper's genome cannot describe.
        """
        joints = tuple(body.joints.values())
        if len(joints) != len(LIMBS):
            raise UserError(
                f"the student 'paper' has two joints, robot '{body.name}' has {len(joints)}",
                mend="give the student a robot with two joints, such as crawler",
            )
        unknown = {"parent": MAIN, "angle_deg": 0.0, "along": 1.0, "height": 0.0}
        return cls(
            main=body.parts[body.root],
            limbs=tuple(body.parts[joint.child] for joint in joints),
            motors=tuple(
                joint.model_copy(update={**unknown, "child": limb})
                for joint, limb in zip(joints, LIMBS, strict=True)
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


def self_model(prior: BodyPrior, genome: Vector) -> Morphology:
    """The body that a genome (alpha rad, lambda, beta rad) describes."""
    alpha, branch, beta = (float(gene) for gene in genome)
    angles = (alpha, beta)
    parents = (MAIN, MAIN if branch else LIMBS[0])
    joints = {
        hinge: motor.model_copy(
            update={"parent": parent, "angle_deg": math.remainder(math.degrees(angle), 360)}
        )
        for hinge, motor, parent, angle in zip(HINGES, prior.motors, parents, angles, strict=True)
    }
    parts = dict(zip((MAIN, *LIMBS), (prior.main, *prior.limbs), strict=True))
    return Morphology(name="self_model", parts=parts, joints=joints)


def true_genome(body: Morphology) -> Vector:
    """(alpha, lambda, beta) of a real two-limbed body, for comparison outside the student."""
    first, second = body.joints.values()
    branch = 0.0 if second.parent == first.child else 1.0
    return np.array([math.radians(first.angle_deg), branch, math.radians(second.angle_deg)])
