"""What the student says of damage to its body, and the body that is left."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.genomes import Genomes
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.self_model import Tree, hinge_name, limb_name

DamageKind = Literal["none", "limb_lost", "joint_locked"]


@dataclass(frozen=True)
class DamageReport:
    """What the student believes happened to its body.

    Attributes:
        noticed_after: After how many commands of the check it was noticed; None if it was not.
        kind: What happened.
        limb: Index of the limb lost, or of the limb whose joint is locked; None if nothing happened.
        joint: Name of that limb's joint.
        locked_angle: Where it is locked, rad; None if it is not.
        probability: Of this kind and limb.
        itself: The body as it was before, by all that was felt before and since.
        body: The new self-model: without a lost limb and all that hung on it; with a locked joint whose travel is
            half a degree to either side.
        motors: For every joint of ``body``, which motor moves it. Motors of lost limbs are not in it.
        words: The same in plain words: what happened, and, once modelled anew, where the limbs hang that are left.
        at_first: What was believed when it was noticed, if the student has modelled itself anew since.
    """

    noticed_after: int | None
    kind: DamageKind
    limb: int | None
    joint: str | None
    locked_angle: float | None
    probability: float
    itself: SelfKnowledge
    body: Morphology
    motors: tuple[int, ...]
    words: tuple[str, ...]
    at_first: DamageReport | None = None

    @classmethod
    def of(
        cls,
        itself: SelfKnowledge,
        kind: DamageKind,
        limb: int,
        angle: float | None,
        probability: float,
        noticed: int | None,
        *,
        at_first: DamageReport | None = None,
        or_else: str | None = None,
    ) -> Self:
        """What is believed to have happened to a body; ``limb`` is -1 where nothing did.

        Args:
            itself: The body as it was before.
            kind: What happened.
            limb: To which limb, or to which limb's joint.
            angle: Where the joint is locked, rad.
            probability: Of this kind and limb.
            noticed: After how many commands it was noticed, if it was.
            at_first: What was believed then, if the student has modelled itself anew since.
            or_else: In words, what else may have happened.
        """
        body, motors = damaged(itself.body, kind, limb, angle)
        words = [damage_in_words(itself.parents, kind, limb, angle, probability)]
        if noticed is not None:
            words[0] += f"; noticed after {noticed} command{'s' if noticed > 1 else ''}"
        if or_else is not None:
            words.append(f"or {or_else}: what I can feel does not tell")
        if at_first is not None:
            words += [itself.words()[motor] for motor in motors]
        return cls(
            noticed_after=noticed,
            kind=kind,
            limb=None if kind == "none" else limb,
            joint=None if kind == "none" else hinge_name(limb),
            locked_angle=angle,
            probability=probability,
            itself=itself,
            body=body,
            motors=motors,
            words=tuple(words),
            at_first=at_first,
        )


def carried_by(parents: Tree, limb: int) -> list[int]:
    """A limb and every limb that hangs on it, directly or not."""
    gone, frontier = [limb], [limb]
    while frontier:
        here = frontier.pop()
        for other, parent in enumerate(parents):
            if parent == here + 1 and other not in gone:
                gone.append(other)
                frontier.append(other)
    return sorted(gone)


def damaged(
    body: Morphology, kind: DamageKind, limb: int, angle: float | None
) -> tuple[Morphology, tuple[int, ...]]:
    """A body after damage, and which motor moves each of the joints that are left."""
    motors = tuple(range(len(body.joints)))
    names = list(body.joints)
    if kind == "joint_locked":
        place = math.degrees(angle or 0.0)
        return body.varied(joints={names[limb]: {"limits_deg": (place - 0.5, place + 0.5)}}), motors
    if kind == "none":
        return body, motors
    parts = [body.root, *(joint.child for joint in body.joints.values())]
    gone = carried_by(tuple(parts.index(joint.parent) for joint in body.joints.values()), limb)
    return body.without(parts[limb + 1]), tuple(motor for motor in motors if motor not in gone)


def suffered(
    bodies: Genomes, kind: DamageKind, limb: int, places: float | Vector = 0.0
) -> tuple[Genomes, Vector]:
    """Bodies after damage, as they are imagined.

    Args:
        bodies: (c,) before.
        kind: What happened.
        limb: To which limb, or to which limb's joint.
        places: (c,) or one angle at which the joint is locked, rad.

    Returns:
        The bodies, a lost limb without length and a locked joint's servo always in that place, and (c, n) how much of
        its command each servo follows.
    """
    values, gains, limbs = bodies.values.copy(), np.ones(bodies.parents.shape), bodies.limbs
    if kind == "limb_lost":
        for one, tree in enumerate(bodies.trees):
            values[one, [2 * limbs + part for part in carried_by(tree, limb)]] = -np.inf
    elif kind == "joint_locked":
        values[:, limbs + limb] = places
        gains[:, limb] = 0.0
    return Genomes(bodies.parents, values), gains


def damage_in_words(parents: Tree, kind: DamageKind, limb: int, angle: float | None, share: float) -> str:
    """What happened, and how probable that is."""
    if kind == "none":
        return f"my body is as I know it ({share:.0%})"
    if kind == "limb_lost":
        gone = [limb_name(part) for part in carried_by(parents, limb)]
        return f"I have lost {' and '.join(gone)} ({share:.0%})"
    place = round(math.degrees(angle or 0.0))
    return f"{hinge_name(limb)} no longer moves, it is stuck near {place} deg ({share:.0%})"
