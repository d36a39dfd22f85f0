"""What a scenario says: who is in the world, what they do, who the student is. Frozen, typed, with units.

Every field has a default where a sensible one exists, so that a file states only what is particular to it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.documents import Source
from testbed.errors import did_you_mean
from testbed.student.parameters import PaperParameters

LARGEST_SEED = 2**32 - 1
MOST_TEACHERS = 8
STUDENT_METHODS = ("paper",)

_STEP_TOLERANCE = 1e-3  # so that 0.01667 and 0.004167 written by hand still are 4 to 1


class Spec(BaseModel):
    """A frozen description in which unknown keys, infinities and NaN are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)


def _field(default: Any, unit: str, **constraints: Any) -> Any:
    return Field(default, json_schema_extra={"unit": unit} if unit else None, **constraints)


Metres = Annotated[float, Field(ge=-100, le=100, json_schema_extra={"unit": "m"})]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=80)]


class JointWave(Spec):
    """A hinge that swings: ``centre + amplitude * sin(2 pi t / period + phase)``; positive is downward."""

    centre_deg: float = Field(0.0, ge=-180, le=180)
    amplitude_deg: float = Field(0.0, ge=0, le=180)
    phase_deg: float = Field(0.0, ge=-360, le=360)

    @property
    def span_deg(self) -> tuple[float, float]:
        """The smallest and the greatest angle, in degrees."""
        return self.centre_deg - self.amplitude_deg, self.centre_deg + self.amplitude_deg


class GaitSpec(Spec):
    """How a teacher moves: over and over (``cyclic``) or not at all (``still``).

    Joints that are not named stay at zero, flat.
    """

    kind: Literal["cyclic", "still"] = "cyclic"
    period: float = _field(2.0, "s", ge=0.1, le=60)
    joints: dict[str, JointWave] = Field(default_factory=dict)
    when: Literal["watched", "always"] = Field(
        "watched", description="move while the student looks, or at all times"
    )

    @model_validator(mode="after")
    def _moves_or_not(self) -> Self:
        if self.kind == "cyclic" and not self.joints:
            raise mistake("a cyclic gait moves no joint", "add 'joints:', or write 'gait: {kind: still}'")
        if self.kind == "still" and self.joints:
            raise mistake(
                "a still gait cannot have joints", "remove 'joints:', or use 'kind: cyclic'", at="joints"
            )
        return self


class LightSpec(Spec):
    """One distant light; the three coefficients are shares of full brightness."""

    direction: tuple[float, float, float] = Field(
        (0.3, -1.0, 1.5), description="toward the light, world frame"
    )
    ambient: float = Field(0.6, ge=0, le=1)
    diffuse: float = Field(0.35, ge=0, le=1)
    specular: float = Field(0.05, ge=0, le=1)

    @field_validator("direction")
    @classmethod
    def _has_a_direction(cls, direction: tuple[float, float, float]) -> tuple[float, float, float]:
        if not 1e-6 < math.hypot(*direction) < 1e6:
            raise mistake("the light's direction has no usable length", "point it up, e.g. [0.3, -1.0, 1.5]")
        return direction


class RigSpec(Spec):
    """The student's stereo cameras: parallel, level, on a post at the world's origin (paper, footnote 3)."""

    height: float = _field(0.15, "m", gt=0, le=2)
    field_of_view_deg: float = Field(50.0, ge=10, le=120, description="horizontal, of one camera")
    baseline: float = _field(
        0.10, "m", gt=0, le=1, description="distance between the cameras; the paper's 10 cm"
    )
    pan_limit_deg: float = Field(90.0, ge=0, le=180)
    pan_speed_deg: float = _field(90.0, "degrees/s", gt=0, le=3600)
    camera_noise: float = _field(2.0, "grey levels", ge=0, le=64, description="standard deviation")
    light: LightSpec = LightSpec()
    background: int = _field(255, "grey levels", ge=0, le=255)
    supersample: int = Field(2, ge=1, le=8, description="rendered pixels per pixel, along each side")
    camera_rate: float = _field(15.0, "images/s", ge=0.001, le=1000)


class WorldSpec(Spec):
    """Time, gravity and ground."""

    control_step: float = _field(1 / 60, "s", ge=1e-5, le=0.5)
    physics_step: float = _field(1 / 240, "s", ge=1e-5, le=0.02)
    max_cycles: int = Field(
        20_000, ge=1, le=10_000_000, description="control steps before the episode is cut"
    )
    tilt_noise_deg: float = Field(0.5, ge=0, le=45, description="standard deviation of the tilt sensor")
    gravity: float = _field(9.81, "m/s2", ge=0, le=100)
    ground_friction: float = Field(1.0, ge=0, le=5)

    @property
    def physics_steps(self) -> int:
        """Physics steps in one control step."""
        return round(self.control_step / self.physics_step)

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        ratio, steps = self.control_step / self.physics_step, self.physics_steps
        if steps < 1 or abs(ratio - steps) > _STEP_TOLERANCE * steps:
            fitting = max(1, steps) * self.physics_step
            what = f"control_step must be a whole multiple of physics_step, not {ratio:.4g} times as long"
            raise mistake(what, f"try control_step: {fitting:.9g}", at="control_step")
        return self


class StudentSpec(Spec):
    """Who learns: a method by name, a body, a place, and what the method leaves open."""

    method: str = "paper"
    robot: str = Field(
        "crawler", min_length=1, description="a shipped robot, or a path beside the scenario file"
    )
    position: tuple[Metres, Metres] = Field((0.0, -1.0), description="x, y in the world")
    parameters: PaperParameters = PaperParameters()

    @field_validator("method")
    @classmethod
    def _is_known(cls, method: str) -> str:
        if method not in STUDENT_METHODS:
            raise mistake(
                f"unknown student '{method}'", did_you_mean(method, STUDENT_METHODS, kind="students")
            )
        return method


class TeacherSpec(Spec):
    """A candidate: a body, what it does, and where it stands as the rig sees it.

    The middle of its flat body is at ``distance`` from the rig's post in the direction ``bearing_deg``,
    positive to the right. Facing 0 points the body's own x axis to the rig's right; positive facings turn it
    counter-clockwise seen from above, so that 90 looks away from the rig.
    """

    robot: str = Field(min_length=1, description="a shipped robot, or a path beside the scenario file")
    gait: GaitSpec
    distance: float = _field(0.9, "m", ge=0.3, le=5)
    bearing_deg: float = Field(0.0, ge=-180, le=180)
    facing_deg: float = Field(0.0, ge=-360, le=360)
    appropriate: bool | None = Field(
        None, description="the truth; derived from the bodies where it is not given"
    )

    @field_validator("gait", mode="before")
    @classmethod
    def _preset(cls, gait: object) -> object:
        return _gait_preset(gait) if isinstance(gait, str) else gait


class Scenario(Spec):
    """An experiment: one world, one student, its candidate teachers, and how often it is tried."""

    name: Identifier
    description: str = Field("", max_length=10_000)
    seed: int = Field(0, ge=0, le=LARGEST_SEED)
    trials: int = Field(1, ge=1, le=1_000_000)
    world: WorldSpec = WorldSpec()
    rig: RigSpec = RigSpec()
    student: StudentSpec = StudentSpec()
    teachers: tuple[TeacherSpec, ...] = Field(max_length=MOST_TEACHERS)

    _source: Source = PrivateAttr(default_factory=Source)

    @property
    def source(self) -> Source:
        """The file and lines that the scenario was read from; empty if it was made in Python."""
        return self._source

    @field_validator("student", mode="before")
    @classmethod
    def _student_by_name(cls, student: object) -> object:
        return {"method": student} if isinstance(student, str) else student

    @field_validator("teachers")
    @classmethod
    def _someone_to_watch(cls, teachers: tuple[TeacherSpec, ...]) -> tuple[TeacherSpec, ...]:
        if not teachers:
            raise mistake(
                "a scenario needs a teacher", "add '- robot: crawler' with a gait under 'teachers:'"
            )
        return teachers

    @model_validator(mode="after")
    def _rig_keeps_up(self) -> Self:
        """An image is taken at a control step, every so many of them."""
        ratio = 1 / (self.rig.camera_rate * self.world.control_step)
        steps = round(ratio)
        if ratio < 1 - _STEP_TOLERANCE:
            fastest = 1 / self.world.control_step
            what = f"rig.camera_rate of {self.rig.camera_rate:g} images/s is faster than the control steps"
            raise mistake(
                what, f"at most {fastest:.4g}, or a smaller world.control_step", at="rig.camera_rate"
            )
        if abs(ratio - steps) > _STEP_TOLERANCE * steps:
            what = (
                f"rig.camera_rate of {self.rig.camera_rate:g} images/s takes an image every {ratio:.4g} control "
                "steps, which must be a whole number"
            )
            fitting = [
                1 / (count * self.world.control_step) for count in (math.ceil(ratio), math.floor(ratio))
            ]
            mend = f"the nearest rates that fit are {fitting[0]:.6g} and {fitting[1]:.6g}"
            raise mistake(what, mend, at="rig.camera_rate")
        return self

    @model_validator(mode="after")
    def _background_is_light(self) -> Self:
        background, dark = self.rig.background, self.student.parameters.looking.dark_below
        if background <= dark:
            what = (
                f"rig.background of {background} is not above student.parameters.looking.dark_below of {dark}"
            )
            mend = "raise rig.background or lower student.parameters.looking.dark_below"
            raise mistake(f"{what}: the student would take it for robots", mend, at="rig.background")
        return self


def _gait_preset(name: str) -> GaitSpec:
    from testbed.world.gaits import PRESETS  # a gait is made of the specs above

    if name not in PRESETS:
        raise mistake(f"unknown gait '{name}'", did_you_mean(name, PRESETS, kind="gaits"))
    return PRESETS[name]
