"""What each mind believed of its own body, held against the truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.experiment import truth
from testbed.experiment.record import Row
from testbed.morphology import Morphology, Vector
from testbed.scenario import Scenario
from testbed.student.body.damage_report import DamageReport
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.self_discovery import SelfDiscoveryRecord
from testbed.student.body.self_model import BodyPrior, Tree, joined, true_tree
from testbed.student.mind import Self

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


def damage_row(found: DamageReport | None, scenario: Scenario) -> Row:
    """What broke, and what the student made of it: empty where nothing broke and nothing was found.

    ``damage`` is the truth and ``damage_found`` the belief, such as ``limb_lost limb_b``; ``damage_named_right``
    whether the right limb was named.
    """
    broken = scenario.student.damage
    limbs = list(scenario.student.body().joints.values())
    names = list(scenario.student.body().joints)
    row: Row = {
        "damage": None,
        "damage_found": None,
        "damage_named_right": None,
        "damage_noticed_after": None,
    }
    limb = None
    if broken is not None and broken.limb_lost is not None:
        row["damage"] = f"limb_lost {broken.limb_lost}"
        limb = [joint.child for joint in limbs].index(broken.limb_lost)
    elif broken is not None and broken.joint_locked is not None:
        row["damage"] = f"joint_locked {broken.joint_locked}"
        limb = names.index(broken.joint_locked)
    if found is not None and found.limb is not None:
        row["damage_found"] = f"{found.kind} {limbs[found.limb].child}"
        row["damage_noticed_after"] = found.noticed_after
    if found is not None and limb is not None:
        row["damage_named_right"] = found.limb == limb
    return row
