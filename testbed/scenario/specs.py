"""What a scenario says: who is in the world, what they do, who the student is. Frozen, typed, with units.

Every field has a default where a sensible one exists, so that a file states only what is particular to it.
"""

from __future__ import annotations

import math
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.documents import Source
from testbed.scenario.base import LARGEST_SEED, STEP_TOLERANCE, Identifier, Spec, unit_field
from testbed.scenario.clutter import MOST_CLUTTER, ClutterSpec
from testbed.scenario.splits import DEVELOPMENT, check_splits
from testbed.scenario.student import MindSpec, StudentSpec
from testbed.scenario.sweep import SweepSpec, sweeps_by_name
from testbed.scenario.teacher import MOST_TEACHERS, GaitSpec, JointWave, TeacherSpec
from testbed.scenario.variation import middle, place_of, plain, replaced, spelled, varied
from testbed.student.methods import STUDENT_METHODS

__all__ = [
    "LARGEST_SEED",
    "MOST_TEACHERS",
    "STUDENT_METHODS",
    "ClutterSpec",
    "GaitSpec",
    "JointWave",
    "LightSpec",
    "MindSpec",
    "RigSpec",
    "Scenario",
    "Spec",
    "StudentSpec",
    "TeacherSpec",
    "WorldSpec",
]

_MAY_VARY = ("world", "rig", "student", "teachers")


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

    height: float = unit_field(0.15, "m", gt=0, le=2)
    field_of_view_deg: float = Field(50.0, ge=10, le=120, description="horizontal, of one camera")
    baseline: float = unit_field(
        0.10, "m", gt=0, le=1, description="distance between the cameras; the paper's 10 cm"
    )
    pan_limit_deg: float = Field(90.0, ge=0, le=180)
    pan_speed_deg: float = unit_field(90.0, "degrees/s", gt=0, le=3600)
    camera_noise: float = unit_field(2.0, "grey levels", ge=0, le=64, description="standard deviation")
    blur: float = unit_field(
        0.0, "pixels", ge=0, le=10, description="of the lens: standard deviation of a point's image"
    )
    gain: float = Field(
        1.0, ge=0.1, le=10, description="exposure: all luminosity times this; 255 is as bright as it gets"
    )
    frame_drops: float = Field(
        0.0, ge=0, le=0.95, description="share of stereo pairs that are lost on their way: the last one stays"
    )
    light: LightSpec = LightSpec()
    background: int = unit_field(255, "grey levels", ge=0, le=255)
    supersample: int = Field(2, ge=1, le=8, description="rendered pixels per pixel, along each side")
    pan_error_deg: float = Field(
        0.0,
        ge=0,
        le=4.5,
        description="how far off its target the rig comes to rest: a standard deviation, drawn for each new target and "
        "never more than two of them, so that whom it looks at still notices",
    )
    renderer: Literal["tinyrenderer", "analytic"] = Field(
        "tinyrenderer",
        description="tinyrenderer: Bullet's; analytic: exact and many times as fast, for bodies without meshes and "
        "textures, see testbed.world.analytic",
    )
    camera_rate: float = unit_field(15.0, "images/s", ge=0.001, le=1000)


class WorldSpec(Spec):
    """Time, gravity and ground."""

    control_step: float = unit_field(1 / 60, "s", ge=1e-5, le=0.5)
    physics_step: float = unit_field(1 / 240, "s", ge=1e-5, le=0.02)
    max_cycles: int = Field(
        20_000, ge=1, le=10_000_000, description="control steps before the episode is cut"
    )
    tilt_noise_deg: float = Field(0.5, ge=0, le=45, description="standard deviation of the tilt sensor")
    gravity: float = unit_field(9.81, "m/s2", ge=0, le=100)
    ground_friction: float = Field(1.0, ge=0, le=5)
    clutter: tuple[ClutterSpec, ...] = Field(
        (), max_length=MOST_CLUTTER, description="things that are no robots"
    )
    arrangement: Literal["apart", "free"] = Field(
        "apart",
        description="apart: each teacher is seen whole and alone in the rig's view; free: they stand anywhere, in "
        "front of each other, half in view or out of it",
    )

    @property
    def physics_steps(self) -> int:
        """Physics steps in one control step."""
        return round(self.control_step / self.physics_step)

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        ratio, steps = self.control_step / self.physics_step, self.physics_steps
        if steps < 1 or abs(ratio - steps) > STEP_TOLERANCE * steps:
            fitting = max(1, steps) * self.physics_step
            what = f"control_step must be a whole multiple of physics_step, not {ratio:.4g} times as long"
            raise mistake(what, f"try control_step: {fitting:.9g}", at="control_step")
        return self


class Scenario(Spec):
    """An experiment: one world, one student, its candidate teachers, and how often it is tried."""

    name: Identifier
    description: str = Field("", max_length=10_000)
    seed: int = Field(0, ge=0, le=LARGEST_SEED)
    trials: int = Field(1, ge=1, le=1_000_000)
    world: WorldSpec = WorldSpec()
    rig: RigSpec = RigSpec()
    student: StudentSpec = StudentSpec()
    beside: tuple[MindSpec, ...] = Field(
        (), max_length=16, description="other minds, who judge the same candidates with the same senses"
    )
    teachers: tuple[TeacherSpec, ...] = Field(max_length=MOST_TEACHERS)
    cells: dict[Identifier, dict[str, Any]] = Field(
        default_factory=dict,
        description="variants by name: what each says otherwise, see testbed.scenario.cells",
    )
    sweep: dict[Identifier, SweepSpec] = Field(
        default_factory=dict, description="variants by the design, see testbed.scenario.sweep"
    )
    split: Identifier | None = Field(
        None, description="what the scenario as it stands is called among its splits"
    )
    splits: dict[Identifier, dict[str, Any]] = Field(
        default_factory=dict,
        description="the same on other teachers and chances, by name, see testbed.scenario.splits",
    )
    variation: dict[str, Any] = Field(
        default_factory=dict,
        description="what is drawn anew for each trial, by place; in files the distributions stand in place",
    )

    _source: Source = PrivateAttr(default_factory=Source)

    @property
    def source(self) -> Source:
        """The file and lines that the scenario was read from; empty if it was made in Python."""
        return self._source

    @property
    def minds(self) -> tuple[MindSpec, ...]:
        """Everybody who judges: the student itself, who leads the body, and those beside it."""
        return (self.student, *self.beside)

    @model_validator(mode="after")
    def _minds_have_names_of_their_own(self) -> Self:
        taken = {self.student.name}
        for index, mind in enumerate(self.beside):
            if mind.name in taken:
                what = f"two students are called '{mind.name}'"
                raise mistake(what, "give each a 'name:' of its own", at=f"beside.{index}")
            taken.add(mind.name)
        return self

    @model_validator(mode="before")
    @classmethod
    def _set_chance_aside(cls, data: object) -> object:
        """The fields hold a middle value where the file has a distribution; ``variation`` keeps the distribution."""
        if not isinstance(data, dict):
            return data
        found = {
            spelled(place): raw for key in _MAY_VARY for place, raw in varied(data.get(key), (key,)).items()
        }
        data = {key: middle(value, (key,)) if key in _MAY_VARY else value for key, value in data.items()}
        for key in ("cells", "splits"):
            if isinstance(data.get(key), dict):
                data[key] = {name: plain(changes) or {} for name, changes in data[key].items()}
        data["sweep"] = sweeps_by_name(data.get("sweep", {}))
        if data.get("splits") and data.get("split") is None:
            data["split"] = DEVELOPMENT
        return {**data, "variation": {**data.get("variation", {}), **found}} if found else data

    @model_validator(mode="after")
    def _variants_are_sound(self) -> Self:
        if self.cells and self.sweep:
            mend = "write the cells as values of an axis: {a: {...}, b: {...}}, or leave one out"
            raise mistake("a scenario has either cells or a sweep", mend, at="sweep")
        check_splits(self.split, self.seed, self.splits)
        return self

    @property
    def template(self) -> dict[str, Any]:
        """The scenario as plain data, as a file would state it: whole, with the distributions in place."""
        data: dict[str, Any] = self.model_dump(mode="json", exclude={"variation"})
        for place, raw in self.variation.items():
            data = replaced(data, place_of(place), raw)
        return data

    @model_validator(mode="after")
    def _rig_keeps_up(self) -> Self:
        """An image is taken at a control step, every so many of them."""
        ratio = 1 / (self.rig.camera_rate * self.world.control_step)
        steps = round(ratio)
        if ratio < 1 - STEP_TOLERANCE:
            fastest = 1 / self.world.control_step
            what = f"rig.camera_rate of {self.rig.camera_rate:g} images/s is faster than the control steps"
            raise mistake(
                what, f"at most {fastest:.4g}, or a smaller world.control_step", at="rig.camera_rate"
            )
        if abs(ratio - steps) > STEP_TOLERANCE * steps:
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
        background = min(255, self.rig.background * self.rig.gain)
        for index, mind in enumerate(self.minds):
            dark = mind.parameters.looking.dark_below
            place = "student" if index == 0 else f"beside.{index - 1}"
            if background <= dark:
                key = f"{place}.parameters.looking.dark_below"
                exposed = "" if self.rig.gain == 1 else f" times rig.gain of {self.rig.gain:g}"
                what = f"rig.background of {self.rig.background}{exposed} is not above {key} of {dark}"
                mend = f"raise rig.background or lower {key}"
                raise mistake(f"{what}: the student would take it for robots", mend, at="rig.background")
        return self
