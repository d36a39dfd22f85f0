"""All that a student's methods leave open, in one place: a name, a default and a reason for each number."""

from __future__ import annotations

from pydantic import Field, model_validator

from testbed.frozen import Frozen
from testbed.student.parameters.baselines import GlanceParameters
from testbed.student.parameters.discovering import (
    ActiveDiscoveryParameters,
    DamageParameters,
    PlausibilityParameters,
    RediscoveryParameters,
    SelfCheckParameters,
)
from testbed.student.parameters.judging import Calibration, LikenessParameters
from testbed.student.parameters.moving import HarmonicsParameters, PerformingParameters, RehearsalParameters
from testbed.student.parameters.paper import (
    DEFAULT_THRESHOLDS,
    ImaginationParameters,
    ImitationParameters,
    LookingParameters,
    SelfDiscoveryParameters,
    TeacherModellingParameters,
    VerdictParameters,
)
from testbed.student.parameters.seeing import (
    EmbodiedParameters,
    FittingParameters,
    JointFitParameters,
    PosingParameters,
    SilhouetteParameters,
    WatchingParameters,
)

__all__ = [
    "DEFAULT_THRESHOLDS",
    "ActiveDiscoveryParameters",
    "Calibration",
    "DamageParameters",
    "EmbodiedParameters",
    "FittingParameters",
    "GlanceParameters",
    "HarmonicsParameters",
    "ImaginationParameters",
    "ImitationParameters",
    "JointFitParameters",
    "LikenessParameters",
    "LookingParameters",
    "PerformingParameters",
    "PlausibilityParameters",
    "PosingParameters",
    "RediscoveryParameters",
    "RehearsalParameters",
    "SelfCheckParameters",
    "SelfDiscoveryParameters",
    "SilhouetteParameters",
    "StudentParameters",
    "TeacherModellingParameters",
    "VerdictParameters",
    "WatchingParameters",
]


class StudentParameters(Frozen):
    """The open parameters of a student, phase by phase; each phase reads those of the method that it is done by."""

    self_discovery: SelfDiscoveryParameters = SelfDiscoveryParameters()
    active_discovery: ActiveDiscoveryParameters | None = Field(
        None, description="Where nothing is said, what suits a body of so many limbs: ``for_limbs``."
    )
    self_check: SelfCheckParameters = SelfCheckParameters()
    imagination: ImaginationParameters = ImaginationParameters()
    looking: LookingParameters = LookingParameters()
    watching: WatchingParameters = WatchingParameters()
    teacher_modelling: TeacherModellingParameters = TeacherModellingParameters()
    joint_fit: JointFitParameters = JointFitParameters()
    embodied: EmbodiedParameters = EmbodiedParameters()
    imitation: ImitationParameters = ImitationParameters()
    rehearsal: RehearsalParameters = RehearsalParameters()
    performing: PerformingParameters = PerformingParameters()
    likeness: LikenessParameters = LikenessParameters()
    verdict: VerdictParameters = VerdictParameters()
    glance: GlanceParameters = GlanceParameters()

    @model_validator(mode="after")
    def _history_divides(self) -> StudentParameters:
        modelling, samples = self.teacher_modelling, self.imitation.samples
        length = modelling.image_pairs * modelling.passes_per_image * modelling.estimation_iterations
        if length % samples:
            raise ValueError(
                f"imitation.samples must divide the length of the parameter history, {length}, not be {samples}"
            )
        return self

    def smoke(self) -> StudentParameters:
        """The same student in a hurry: every phase runs, none long enough to mean anything."""
        data = self.model_dump()
        hasty = {"key_frames": 3, "rounds": 1, "iterations": 5, "lengths": (1.0,)}
        hasty["posing"] = data["embodied"]["fitting"]["posing"] | {"places": 4, "rolls": 6, "angles": 12}
        short: dict[str, dict[str, object]] = {
            "self_discovery": {"commands": 3, "iterations": 4, "settle_time": 0.5},
            "teacher_modelling": {"passes_per_image": 30},
            "imitation": {"iterations": 6, "samples": 2},
            "active_discovery": {"commands": 4, "evaluations": 200},
            "self_check": {"checks": 1},
            "watching": {"duration": 1.0, "rate": 8.0},
            "embodied": {"finalists": 1, "fitting": data["embodied"]["fitting"] | hasty},
            "rehearsal": {"samples": 12, "restarts": 2, "climbing": 4},
            "performing": {"practice": 2, "cycles": 1.0, "seconds": 2.0},
        }
        for phase, changes in short.items():
            data[phase] = {**(data[phase] or {}), **changes}
        modelling = data["teacher_modelling"]
        length = modelling["image_pairs"] * modelling["passes_per_image"] * modelling["estimation_iterations"]
        data["imitation"]["samples"] = max(count for count in range(2, 25) if length % count == 0)
        return StudentParameters.model_validate(data)
