"""The student of a scenario: a mind, made of named phases that can be exchanged one by one, in a body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self, TypeAlias

from pydantic import Field, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.errors import did_you_mean
from testbed.scenario.base import Identifier, Metres, Spec, unit_field
from testbed.scenario.bodies import Robot, body_of
from testbed.scenario.variation import Spread
from testbed.student.methods import (
    METHODS,
    STUDENT_METHODS,
    Imitation,
    Phases,
    SelfDiscovery,
    TeacherModelling,
    VerdictRule,
)
from testbed.student.parameters import StudentParameters

if TYPE_CHECKING:
    from testbed.bodies.morphology import Morphology

Deviation: TypeAlias = Spread | tuple[float, ...]
"""How far something may be from what is known: a standard deviation, a distribution, or the values themselves."""


class MindSpec(Spec):
    """How a student thinks: a method by name, any of its phases exchanged, and what is left open."""

    name: Identifier = Field("paper", description="what reports call it; its method where it is not given")
    method: str = "paper"
    self_discovery: SelfDiscovery | None = Field(
        None,
        description="Section 3.2: from commands and tilt to a self-model. hill_climber is the paper's; active "
        "(extension) chooses the commands that tell most",
    )
    teacher_modelling: TeacherModelling | None = Field(
        None,
        description="Section 3.3: from stereo images to a teacher model. eea is the paper's; joint_fit (extension) "
        "fits free parts to all frames at once, embodied (extension) the student's own self-model",
    )
    imitation: Imitation | None = Field(
        None,
        description="Section 3.4: from a teacher model to a controller. hill_climber is the paper's; rehearsed "
        "(extension) searches the same controller with restarts and plays the motion back smoothly",
    )
    verdict: VerdictRule | None = Field(
        None,
        description="Section 3.4 and Fig. 8: who is like me? controller is the paper's; attachment (extension) looks "
        "at what hangs on what, likelihood (extension) compares its own body with those it could have had",
    )
    parameters: StudentParameters = StudentParameters()

    @model_validator(mode="before")
    @classmethod
    def _named_after_its_method(cls, data: object) -> object:
        if isinstance(data, str):
            return {"name": data, "method": data}
        if isinstance(data, dict) and data.get("name") is None:
            method = data.get("method")
            return {**data, "name": method if method in STUDENT_METHODS else "paper"}
        return data

    @field_validator("method")
    @classmethod
    def _is_known(cls, method: str) -> str:
        if method not in STUDENT_METHODS:
            raise mistake(
                f"unknown student '{method}'", did_you_mean(method, STUDENT_METHODS, kind="students")
            )
        return method

    @model_validator(mode="after")
    def _phases_fit(self) -> Self:
        seen, judged = self.phases.teacher_modelling, self.phases.verdict
        if judged == "likelihood" and seen != "embodied":
            what = f"verdict likelihood compares bodies, which teacher_modelling {seen} does not"
            raise mistake(what, "add 'verdict: controller', or use teacher_modelling: embodied", at="verdict")
        if judged == "attachment" and seen == "embodied":
            what = "verdict attachment needs parts that nothing ties together; teacher_modelling embodied ties them"
            raise mistake(what, "use teacher_modelling: joint_fit", at="verdict")
        return self

    @property
    def phases(self) -> Phases:
        """The method of every phase, the mind's own where the scenario does not choose another."""
        own = METHODS[self.method]
        return Phases(
            self.self_discovery or own.self_discovery,
            self.teacher_modelling or own.teacher_modelling,
            self.imitation or own.imitation,
            self.verdict or own.verdict,
        )


class RealityGap(Spec):
    """How the student's true body differs from the one that it knows of: the world's secret.

    A number is the standard deviation of a normal draw for each joint, limb, part or axis by itself, for each trial;
    a distribution is drawn likewise; a list states the values themselves, one for each. Offsets add to what is
    known, factors multiply it.
    """

    servo_offset_deg: Deviation = Field(0.0, description="each joint turns this much further than commanded")
    servo_lag: Deviation = Field(
        0.0,
        description="s: each servo takes this much longer to begin; what is drawn below 0 counts as above",
    )
    limb_length: Deviation = Field(0.0, description="factor - 1 of each limb's length; 0.1: some 10%")
    density: Deviation = Field(0.0, description="factor - 1 of each part's density")
    friction: Deviation = Field(0.0, description="factor - 1 of each part's friction")
    tilt_bias_deg: Deviation = Field(0.0, description="what the tilt sensor adds, to the side and nose-down")


class DamageSpec(Spec):
    """What breaks in the middle of the student's life; its commands keep their number and meaning."""

    limb_lost: str | None = Field(
        None, description="this limb falls off, with all that hangs on it; 'random': any"
    )
    joint_locked: str | None = Field(None, description="this joint stays where it is; 'random': any")
    at: float = unit_field(40.0, "s", ge=0, le=100_000, description="since the beginning of its life")

    @model_validator(mode="after")
    def _one_thing_breaks(self) -> Self:
        if (self.limb_lost is None) == (self.joint_locked is None):
            raise mistake(
                "damage is either 'limb_lost:' or 'joint_locked:'", "write e.g. {limb_lost: limb_b, at: 40}"
            )
        return self


class StudentSpec(MindSpec):
    """Who learns: a mind, a body and a place."""

    robot: Robot = Field("crawler", description="a shipped robot, a path beside the scenario file, or a plan")
    position: tuple[Metres, Metres] = Field((0.0, -1.0), description="x, y in the world")
    reality_gap: RealityGap | None = None
    damage: DamageSpec | None = None

    def body(self) -> Morphology:
        """The body as the student knows its parts.

        Raises:
            UserError: As :func:`testbed.scenario.bodies.body_of` does.
        """
        return body_of(self.robot)

    def true_body(self) -> Morphology:
        """The body as it really is before any damage; the same where there is no reality gap, or none is drawn yet."""
        body, gap = self.body(), self.reality_gap or RealityGap()
        if isinstance(gap.limb_length, tuple):
            body = body.stretched(gap.limb_length)
        changes: dict[str, dict[str, object]] = {name: {} for name in body.parts}
        for field in ("density", "friction"):
            factors = getattr(gap, field)
            for name, factor in zip(body.parts, factors if isinstance(factors, tuple) else (), strict=False):
                changes[name][field] = getattr(body.parts[name], field) * factor
        return body.varied(parts=changes) if any(changes.values()) else body
