"""What each mind believed of its own body, held against the truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.experiment import truth
from testbed.experiment.record import Row
from testbed.scenario import Scenario
from testbed.student.body.damage_report import DamageKind, DamageReport, carried_by
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.self_discovery import SelfDiscoveryRecord
from testbed.student.body.self_model import BodyPrior, Tree, joined, true_tree
from testbed.student.forms import Self

Arrays = dict[str, NDArray[Any]]


def self_arrays(itself: Self, known: Morphology, body: Morphology) -> Arrays:
    """How a self-model came about; see :mod:`testbed.experiment.trial_report`.

    Args:
        itself: What the mind found out.
        known: The body as the student knows its parts.
        body: The true body.
    """
    prior = BodyPrior.of(known)
    true_parents, true_angles = true_tree(body)
    arrays = {
        "parents": np.array([parents for parents, _ in itself.stages]),
        "angles": np.array([angles for _, angles in itself.stages]),
        "error": itself.errors,
        "objective": np.array(
            [
                truth.self_model_error(joined(prior, parents, angles), body)
                for parents, angles in itself.stages
            ]
        ),
        "commands": itself.commands,
        "tilt": itself.tilt,
        "truth_parents": np.array(true_parents),
        "truth_angles": true_angles,
    }
    if isinstance(itself, SelfKnowledge):
        arrays["words"] = np.array(itself.words())
    if isinstance(itself, SelfDiscoveryRecord):
        arrays["believed_tilt"] = itself.believed_tilt
    return arrays


def self_row(itself: Self, scenario: Scenario, body: Morphology) -> Row:
    """One row a mind: was it right about its body?

    ``topology_right``: every limb hangs where the model has it. ``angle_error_deg``: the largest error of a mounting
    angle, None where the topology is wrong.
    """
    (parents, angles), (true_parents, true_angles) = itself.stages[-1], true_tree(body)
    right = parents == true_parents
    gaps = np.abs((angles - true_angles + math.pi) % math.tau - math.pi)
    return {
        "robot": body.name,
        "commands": len(itself.commands),
        "topology_right": right,
        "angle_error_deg": float(np.degrees(gaps.max())) if right else None,
        **(_known(itself, true_parents, true_angles) if isinstance(itself, SelfKnowledge) else {}),
    }


def _known(itself: SelfKnowledge, parents: Tree, angles: Vector) -> Row:
    """What the posterior says, and whether the truth lies in it."""
    return {
        "identifiable": all(itself.identifiable),
        "posterior_holds_truth": itself.holds(parents, angles),
        "evaluations": itself.evaluations,
    }


def damage_row(found: DamageReport | None, scenario: Scenario, body: Morphology, joints: Vector) -> Row:
    """What broke, and what the student made of it: empty where nothing broke and nothing was found.

    ``damage`` is the truth and ``damage_found`` the belief, such as ``limb_lost limb_b``, with a probability of
    ``damage_share``; ``damage_named_right`` whether the right limb was named, ``damage_kind_right`` whether it is
    rightly said to be lost or stuck, which a limb stuck off the ground hardly shows. ``alarm_withdrawn`` says of an
    alarm whether the student came to think that it was none. What ends in ``_first`` was believed when the damage was
    noticed, what does not after the student had modelled itself anew: does what is left hang where it says
    (``left_topology_right``), by how much are its mounting angles wrong (``left_angle_error_deg``, the largest; None
    where the topology is), are they known (``left_identifiable``), and by how much is the angle wrong at which a joint
    is stuck (``locked_error_deg``)?

    Args:
        found: What the student believes.
        scenario: The trial's own scenario.
        body: The true body before.
        joints: (t, n) its true joint angles all through its life, rad.
    """
    row: Row = dict.fromkeys(_OF_DAMAGE)
    broken, names = _broken(scenario, body)
    if broken is not None:
        row["damage"] = f"{broken[0]} {names[broken[1]]}"
    if found is not None and found.noticed_after is not None:
        row["alarm_withdrawn"] = found.kind == "none"
    if found is not None and found.limb is not None:
        row["damage_found"] = f"{found.kind} {names[found.limb]}"
        row["damage_share"] = found.probability
        row["damage_noticed_after"] = found.noticed_after
    if found is None or broken is None:
        return row
    row["damage_named_right"] = found.limb == broken[1]
    row["damage_kind_right"] = found.kind == broken[0]
    if found.noticed_after is not None:
        row |= _of_what_is_left(found, broken, body, joints)
        first = _of_what_is_left(found.at_first or found, broken, body, joints)
        row |= {f"{name}_first": value for name, value in first.items() if f"{name}_first" in row}
        row["damage_named_right_first"] = (found.at_first or found).limb == broken[1]
    return row


_OF_DAMAGE = (
    "damage",
    "damage_found",
    "damage_share",
    "damage_named_right",
    "damage_named_right_first",
    "damage_kind_right",
    "damage_noticed_after",
    "alarm_withdrawn",
    "left_topology_right",
    "left_angle_error_deg",
    "left_angle_error_deg_first",
    "left_identifiable",
    "locked_error_deg",
    "locked_error_deg_first",
)


def _broken(scenario: Scenario, body: Morphology) -> tuple[tuple[DamageKind, int] | None, list[str]]:
    """What broke and which limb's, and the names of the limbs."""
    limbs, broken = [joint.child for joint in body.joints.values()], scenario.student.damage
    if broken is None:
        return None, limbs
    if broken.limb_lost is not None:
        return ("limb_lost", limbs.index(broken.limb_lost)), limbs
    return ("joint_locked", list(body.joints).index(str(broken.joint_locked))), limbs


def _of_what_is_left(
    found: DamageReport, broken: tuple[DamageKind, int], body: Morphology, joints: Vector
) -> Row:
    """How right the student is about the limbs that it still has, and about the angle of a locked joint."""
    kind, limb = broken
    parents, angles = true_tree(body)
    gone = carried_by(parents, limb) if kind == "limb_lost" else []
    left = [one for one in range(len(parents)) if one not in gone]
    right = all(found.itself.parents[one] == parents[one] for one in left)
    row: Row = {"left_topology_right": right}
    if right and left:
        gaps = np.abs((found.itself.angles - angles + math.pi) % math.tau - math.pi)
        row["left_angle_error_deg"] = float(np.degrees(gaps[left].max()))
        row["left_identifiable"] = all(found.itself.identifiable[one] for one in left)
    if kind == found.kind == "joint_locked" and found.limb == limb:
        row["locked_error_deg"] = abs(math.degrees((found.locked_angle or 0.0) - float(joints[-1, limb])))
    return row
