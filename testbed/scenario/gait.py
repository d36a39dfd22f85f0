"""How the teachers of a scenario move: waves of every joint, a recording, a push, chance, or nothing at all."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.errors import did_you_mean
from testbed.scenario.base import Spec, unit_field
from testbed.scenario.variation import Choice, Distribution, Spread, Uniform

WaveForm = Literal["sine", "triangle", "trapezoid"]


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


class AnswerSpec(Spec):
    """When a teacher that answers moves: social contingency (Section 5), as an animal would show it."""

    delay: float = unit_field(0.3, "s", ge=0, le=60, description="from what it sees to when it begins")
    duration: float = unit_field(
        4.0, "s", ge=0.1, le=600, description="how long it goes on after the last that it saw"
    )
    least_speed_deg: float = unit_field(
        20.0, "degrees/s", gt=0, le=3600, description="slower turns of the student's limbs go unnoticed"
    )


Stretch = Annotated[float, Field(ge=0.1, le=10)]


class GaitSpec(Spec):
    """How a teacher moves.

    ``cyclic``: over and over; joints that are not named stay flat. ``still``: not at all. ``random``: drawn for each
    trial, every joint of whatever body; a body without joints is pushed. ``push``: rolled or slid to and fro along its
    own x axis at ``speed``, for half a period each way. ``replay``: as recorded in a file, over and over.

    ``preset: crawl`` stands for all that the preset of that name says; what is said beside goes before it.
    """

    kind: Literal["cyclic", "still", "random", "push", "replay"] = "cyclic"
    period: float = unit_field(2.0, "s", ge=0.1, le=60)
    joints: dict[str, JointWave] = Field(default_factory=dict)
    wave_form: WaveForm = "sine"
    speed: float = unit_field(0.08, "m/s", ge=0, le=2, description="of a body that is pushed")
    file: str | None = Field(
        None,
        min_length=1,
        description="a recording, .csv or .parquet, beside the scenario: see testbed.recording",
    )
    random: RandomWaves = Field(RandomWaves(), description="the ranges of a random gait")
    mirrored: bool = Field(
        False,
        description="as in a mirror: it stands the other way round, and limbs on its left and right change roles",
    )
    stretched: Stretch = Field(1.0, description="how many times as long everything takes")
    when: Literal["watched", "always", "answering"] = Field(
        "watched", description="move while the student looks, at all times, or after the student has moved"
    )
    answer: AnswerSpec = Field(AnswerSpec(), description="of a gait that is performed when: answering")

    @model_validator(mode="before")
    @classmethod
    def _preset(cls, data: object) -> object:
        rest = {"preset": data} if isinstance(data, str) else data
        if not isinstance(rest, dict) or "preset" not in rest:
            return data
        from testbed.world.gaits import PRESETS  # a gait is made of the specs above

        name = rest["preset"]
        if name not in PRESETS:
            raise mistake(f"unknown gait '{name}'", did_you_mean(str(name), PRESETS, kind="gaits"))
        return {**PRESETS[name].model_dump(), **{key: rest[key] for key in rest if key != "preset"}}

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
        if (self.kind == "replay") != (self.file is not None):
            raise mistake("a replay and its file belong together", "write {kind: replay, file: wave.csv}")
        return self
