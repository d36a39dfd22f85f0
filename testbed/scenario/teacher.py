"""The teachers of a scenario: a body, its size and looks, how it moves and where it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, field_validator

from testbed.bodies.parts import Texture
from testbed.document_errors import mistake
from testbed.scenario.base import Spec, unit_field
from testbed.scenario.bodies import Robot, body_of
from testbed.scenario.gait import AnswerSpec, GaitSpec, Harmonic, JointWave, RandomWaves, WaveForm, waved

if TYPE_CHECKING:
    from testbed.bodies.morphology import Morphology

__all__ = [
    "FARTHEST",
    "MOST_TEACHERS",
    "AnswerSpec",
    "GaitSpec",
    "Harmonic",
    "JointWave",
    "RandomWaves",
    "TeacherSpec",
    "WaveForm",
    "waved",
]

MOST_TEACHERS = 8
FARTHEST = 5.0  # metres
Factor = Annotated[float, Field(ge=0.1, le=10)]
Grey = Annotated[float, Field(ge=0, le=255)]


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
    density: Factor = Field(1.0, description="how many times as heavy it is, size for size")
    friction: Annotated[float, Field(ge=0, le=10)] = Field(
        1.0, description="how many times as much its parts rub on the ground"
    )
    luminosity: Grey | tuple[Grey, ...] | None = Field(
        None, description="grey level of its parts: of all, or of one after the other; its own if not said"
    )
    texture: Texture | None = Field(None, description="a pattern on all of its parts")
    gait: GaitSpec
    distance: float = unit_field(0.9, "m", ge=0.3, le=FARTHEST)
    fit: bool | None = Field(
        None,
        description="move it back to the nearest distance at which it fits in view; where this is not said, only if "
        "its body or its distance is drawn",
    )
    bearing_deg: float = Field(0.0, ge=-180, le=180)
    facing_deg: float = Field(0.0, ge=-360, le=360)
    height: float = unit_field(
        0.0, "m", ge=0, le=1, description="of the pedestal that it stands on, as pale as the background"
    )
    away: tuple[tuple[float, float], ...] = Field(
        (), max_length=100, description="from when to when (s since the beginning) it is out of sight"
    )
    appropriate: bool | None = Field(
        None, description="the truth; derived from the bodies where it is not given"
    )

    @field_validator("away")
    @classmethod
    def _in_order(cls, away: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        times = [time for span in away for time in span]
        if any(later <= earlier for earlier, later in zip([-1e-9, *times], times, strict=False)):
            raise mistake("the times of 'away' do not rise", "write [[leaves, returns], ...] in seconds")
        return away

    def body(self) -> Morphology:
        """The teacher's body, in its own size and with its own looks.

        Raises:
            UserError: As :func:`testbed.scenario.bodies.body_of` does.
        """
        body = body_of(self.robot)
        if self.limb_scale != 1.0:
            body = body.stretched(self.limb_scale)
        if self.scale != 1.0:
            body = body.scaled(self.scale)
        return self._made_of_another_stuff(body)

    def _made_of_another_stuff(self, body: Morphology) -> Morphology:
        parts = dict(body.parts)
        greys = self.luminosity if isinstance(self.luminosity, tuple) else [self.luminosity] * len(parts)
        for name, grey in zip(parts, [*greys, *[None] * len(parts)], strict=False):
            part = parts[name]
            changes: dict[str, object] = {}
            if self.density != 1.0:
                changes["density"] = part.density * self.density
            if self.friction != 1.0:
                changes["friction"] = part.friction * self.friction
            if grey is not None:
                changes["luminosity"] = round(grey)
            if self.texture is not None:
                changes["texture"] = self.texture
            parts[name] = part.model_copy(update=changes) if changes else part
        return body.model_copy(update={"parts": parts}) if parts != body.parts else body
