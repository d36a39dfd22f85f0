"""The teachers of a scenario: a body, its size, how it moves and where it stands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.errors import did_you_mean
from testbed.scenario_base import Spec, unit_field
from testbed.scenario_bodies import Robot, body_of
from testbed.scenario_variation import Choice, Distribution, Spread, Uniform

if TYPE_CHECKING:
    from testbed.morphology import Morphology

MOST_TEACHERS = 8
FARTHEST = 5.0  # metres
WaveForm = Literal["sine", "triangle", "trapezoid"]
Factor = Annotated[float, Field(ge=0.1, le=10)]


class Harmonic(Spec):
    """A faster part of a swing: ``amplitude * sin(order * 2 pi t / period + phase)``."""

    order: int = Field(2, ge=2, le=8)
    amplitude_deg: float = Field(0.0, ge=0, le=180)
    phase_deg: float = Field(0.0, ge=-360, le=360)


class JointWave(Spec):
    """A hinge that swings: ``centre + amplitude * sin(2 pi t / period + phase)``; positive is downward."""

    centre_deg: float = Field(0.0, ge=-180, le=180)
    amplitude_deg: float = Field(0.0, ge=0, le=180)
    phase_deg: float = Field(0.0, ge=-360, le=360)
    harmonics: tuple[Harmonic, ...] = Field((), max_length=8, description="added to the swing")

    @property
    def span_deg(self) -> tuple[float, float]:
        """Between which angles (degrees) the hinge stays."""
        swing = self.amplitude_deg + sum(wave.amplitude_deg for wave in self.harmonics)
        return self.centre_deg - swing, self.centre_deg + swing


def waved(phase: Any, form: WaveForm) -> Any:
    """A wave between -1 and 1 in the rhythm of a sine: the sine, a triangle, or one with its tops cut off."""
    if form == "sine":
        return np.sin(phase)
    triangle = np.arcsin(np.sin(phase)) * 2 / math.pi
    return triangle if form == "triangle" else np.clip(2 * triangle, -1, 1)


_RANDOM_BOUNDS = {
    "period": (0.1, 60.0),
    "amplitude_deg": (0.0, 180.0),
    "phase_deg": (-360.0, 360.0),
    "centre": (-1.0, 1.0),
    "second_harmonic": (0.0, 1.0),
    "speed": (0.0, 2.0),
}


class RandomWaves(Spec):
    """How a ``random`` gait is drawn: for each trial, and but for period and wave form for each joint by itself.

    Centres lie where the swing stays within the joint's travel; a joint that cannot swing as far as the amplitude
    drawn swings as far as it can.
    """

    period: Spread = Field(Uniform(uniform=(1.3, 3.0)), description="s; slow enough for hobby servos")
    amplitude_deg: Spread = Field(
        Uniform(uniform=(15, 40)), description="at least 15: each joint is seen to move"
    )
    phase_deg: Spread = Uniform(uniform=(-180, 180))
    centre: Spread = Field(
        Uniform(uniform=(-0.8, 0.8)),
        description="from -1 to 1: from the lowest to the highest centre that the joint's travel leaves",
    )
    wave_form: WaveForm | Choice = Field("sine", description="one of them or {choice: [...]}")
    second_harmonic: Spread = Field(0.0, description="amplitude of a second harmonic, in amplitudes")
    speed: Spread = Field(
        Uniform(uniform=(0.04, 0.12)), description="m/s, of a body without joints: it rolls"
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for name, (least, most) in _RANDOM_BOUNDS.items():
            spread = getattr(self, name)
            ends = spread.ends if isinstance(spread, Distribution) else (spread,)
            if min(ends) < least or max(ends) > most:
                what = f"{name} of a random gait reaches from {min(ends):g} to {max(ends):g}"
                raise mistake(what, f"stay between {least:g} and {most:g}", at=name)
        return self

    @field_validator("wave_form")
    @classmethod
    def _known_forms(cls, form: WaveForm | Choice) -> WaveForm | Choice:
        for one in form.choice if isinstance(form, Choice) else ():
            if one not in ("sine", "triangle", "trapezoid"):
                raise mistake(f"there is no wave form '{one}'", "use sine, triangle or trapezoid")
        return form


class GaitSpec(Spec):
    """How a teacher moves.

    ``cyclic``: over and over; joints that are not named stay flat. ``still``: not at all. ``random``: drawn for each
    trial, every joint of whatever body; a body without joints is pushed. ``push``: rolled to and fro along its own x
    axis at ``speed``, for half a period each way.
    """

    kind: Literal["cyclic", "still", "random", "push"] = "cyclic"
    period: float = unit_field(2.0, "s", ge=0.1, le=60)
    joints: dict[str, JointWave] = Field(default_factory=dict)
    wave_form: WaveForm = "sine"
    speed: float = unit_field(0.08, "m/s", ge=0, le=2, description="of a body that is pushed")
    random: RandomWaves = Field(RandomWaves(), description="the ranges of a random gait")
    when: Literal["watched", "always"] = Field(
        "watched", description="move while the student looks, or at all times"
    )

    @model_validator(mode="after")
    def _moves_or_not(self) -> Self:
        if self.kind == "cyclic" and not self.joints:
            raise mistake("a cyclic gait moves no joint", "add 'joints:', or write 'gait: {kind: still}'")
        if self.kind != "cyclic" and self.joints:
            raise mistake(
                f"a {self.kind} gait cannot have joints",
                "remove 'joints:', or use 'kind: cyclic'",
                at="joints",
            )
        return self


class TeacherSpec(Spec):
    """A candidate: a body, what it does, and where it stands as the rig sees it.

    The middle of its flat body is at ``distance`` from the rig's post in the direction ``bearing_deg``,
    positive to the right. Facing 0 points the body's own x axis to the rig's right; positive facings turn it
    counter-clockwise seen from above, so that 90 looks away from the rig.
    """

    robot: Robot = Field(description="a shipped robot, a path beside the scenario file, or a plan")
    scale: Factor = Field(1.0, description="size of the whole body, in its own sizes")
    limb_scale: Factor | tuple[Factor, ...] = Field(
        1.0, description="length of the limbs, in their own lengths: for all, or one after the other"
    )
    gait: GaitSpec
    distance: float = unit_field(0.9, "m", ge=0.3, le=FARTHEST)
    fit: bool | None = Field(
        None,
        description="move it back to the nearest distance at which it fits in view; where this is not said, only if "
        "its body or its distance is drawn",
    )
    bearing_deg: float = Field(0.0, ge=-180, le=180)
    facing_deg: float = Field(0.0, ge=-360, le=360)
    appropriate: bool | None = Field(
        None, description="the truth; derived from the bodies where it is not given"
    )

    @field_validator("gait", mode="before")
    @classmethod
    def _preset(cls, gait: object) -> object:
        return _gait_preset(gait) if isinstance(gait, str) else gait

    def body(self) -> Morphology:
        """The teacher's body, in its own size.

        Raises:
            UserError: As :func:`testbed.scenario_bodies.body_of` does.
        """
        body = body_of(self.robot)
        if self.limb_scale != 1.0:
            body = body.stretched(self.limb_scale)
        return body.scaled(self.scale) if self.scale != 1.0 else body


def _gait_preset(name: str) -> GaitSpec:
    from testbed.world.gaits import PRESETS  # a gait is made of the specs above

    if name not in PRESETS:
        raise mistake(f"unknown gait '{name}'", did_you_mean(name, PRESETS, kind="gaits"))
    return PRESETS[name]
