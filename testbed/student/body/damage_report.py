"""What the student says of damage to its body, and the body that is left."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from testbed.morphology import Morphology
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
        body: The new self-model: without a lost limb and all that hung on it; with a locked joint whose travel is
            half a degree to either side.
        motors: For every joint of ``body``, which motor moves it. Motors of lost limbs are not in it.
        words: The same in plain words.
    """

    noticed_after: int | None
    kind: DamageKind
    limb: int | None
    joint: str | None
    locked_angle: float | None
    probability: float
    body: Morphology
    motors: tuple[int, ...]
    words: str


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
    parents = tuple(parts.index(joint.parent) for joint in body.joints.values())
    gone = carried_by(parents, limb)
    lost = {parts[one + 1] for one in gone}
    left = Morphology(
        name=body.name,
        parts={name: part for name, part in body.parts.items() if name not in lost},
        joints={name: joint for name, joint in body.joints.items() if joint.child not in lost},
    )
    return left, tuple(motor for motor in motors if motor not in gone)


def damage_in_words(
    parents: Tree, kind: DamageKind, limb: int, angle: float | None, share: float, noticed: int | None
) -> str:
    """What happened, how probable that is, and when it was noticed."""
    if kind == "none":
        return f"my body is as I know it ({share:.0%})"
    when = (
        "not yet certain"
        if noticed is None
        else f"noticed after {noticed} command{'s' if noticed > 1 else ''}"
    )
    if kind == "limb_lost":
        gone = [limb_name(part) for part in carried_by(parents, limb)]
        return f"I have lost {' and '.join(gone)} ({share:.0%}); {when}"
    stuck = f"{hinge_name(limb)} no longer moves, it is stuck near {math.degrees(angle or 0.0):.0f} deg"
    return f"{stuck} ({share:.0%}); {when}"
