"""Which body a scenario means: a shipped robot, a file beside the scenario, or a tree of limbs written out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from testbed.document_errors import mistake
from testbed.errors import UserError
from testbed.scenario.base import Spec

if TYPE_CHECKING:
    from testbed.bodies.morphology import Morphology

MOST_LIMBS = 26
_SUFFIXES = (".yaml", ".yml", ".urdf", ".xacro", ".csv", ".parquet")
_LETTERS = "abcdefghijklmnopqrstuvwxyz"


class LimbSpec(Spec):
    """Where a limb of a tree hangs: on the main body (``main``) or at the far end of an earlier limb (``limb_a``)."""

    on: str = "main"
    angle_deg: float = Field(0.0, ge=-360, le=360, description="mounting angle, seen from above")


class RandomTree(Spec):
    """A tree drawn for each trial: each limb on any of the parts before it, at any angle."""

    limbs: int = Field(2, ge=1, le=MOST_LIMBS)


class BodyPlan(Spec):
    """A body made of another's parts: its main body, and its first limb as often as there are limbs."""

    parts_of: str = Field(
        "crawler", min_length=1, description="a shipped robot, or a path beside the scenario"
    )
    tree: tuple[LimbSpec, ...] | None = Field(None, min_length=1, max_length=MOST_LIMBS)
    random: RandomTree | None = None

    @model_validator(mode="after")
    def _one_of_the_two(self) -> Self:
        if (self.tree is None) == (self.random is None):
            raise mistake("a robot needs either 'tree:' or 'random:'", "write e.g. {random: {limbs: 2}}")
        known = ["main"]
        for index, limb in enumerate(self.tree or ()):
            if limb.on not in known:
                what = f"limb {index + 1} of the tree hangs on '{limb.on}', which does not come before it"
                raise mistake(what, f"choose among {', '.join(known)}", at=f"tree.{index}.on")
            known.append(f"limb_{_LETTERS[index]}")
        return self


def _kind(value: Any) -> str:
    return "plan" if isinstance(value, dict | BodyPlan) else "name"


Robot = Annotated[
    Annotated[str, Field(min_length=1), Tag("name")] | Annotated[BodyPlan, Tag("plan")], Discriminator(_kind)
]
"""A shipped robot's name, a path beside the scenario file, or a plan."""


def is_path(robot: object) -> bool:
    """Whether a scenario's ``robot`` is a file rather than the name of a shipped robot; recordings are files too."""
    return isinstance(robot, str) and ("/" in robot or robot.endswith(_SUFFIXES))


def body_of(robot: str | BodyPlan) -> Morphology:
    """The body that is meant.

    Raises:
        UserError: If there is no such robot, its description is wrong, or it has yet to be drawn.
    """
    from testbed.bodies.morphology import (  # made of our own documents
        CappedCylinder,
        Joint,
        Morphology,
        load_robot,
    )

    if isinstance(robot, str):
        return load_robot(Path(robot) if is_path(robot) else robot)
    if robot.tree is None:
        raise UserError("the robot has yet to be drawn", "use testbed.scenario.drawn(scenario, trial)")
    like = load_robot(robot.parts_of)
    hinge = next(iter(like.joints.values()), None)
    limb = like.parts[hinge.child] if hinge is not None else None
    if hinge is None or not isinstance(limb, CappedCylinder):
        raise UserError(f"robot '{like.name}' has no limbs to make a tree of", "try parts_of: crawler")
    limbs = [f"limb_{letter}" for letter in _LETTERS[: len(robot.tree)]]
    joints = {
        f"joint_{name[-1]}": Joint(
            **{
                **hinge.model_dump(),
                "parent": "body" if spec.on == "main" else spec.on,
                "child": name,
                "angle_deg": spec.angle_deg,
                "along": 1.0,
            }
        )
        for name, spec in zip(limbs, robot.tree, strict=True)
    }
    parts = {"body": like.parts[like.root], **dict.fromkeys(limbs, limb)}
    return Morphology(name="tree", description="a tree of limbs", parts=parts, joints=joints)


def drawn_tree(plan: BodyPlan, rng: np.random.Generator) -> BodyPlan:
    """A plan with its random tree drawn: whole tenths of a degree, so that reports can be read."""
    if plan.random is None:
        return plan
    names = ["main", *(f"limb_{letter}" for letter in _LETTERS)]
    tree = tuple(
        LimbSpec(
            on=names[0 if index == 0 else int(rng.integers(index + 1))],
            angle_deg=round(float(rng.uniform(-180, 180)), 1),
        )
        for index in range(plan.random.limbs)
    )
    return BodyPlan(parts_of=plan.parts_of, tree=tree)
