"""What the baselines leave open: how candidates are glanced at, and how that becomes an answer."""

from __future__ import annotations

from pydantic import Field

from testbed.frozen import Frozen
from testbed.student.parameters.judging import Calibration
from testbed.student.parameters.seeing import SilhouetteParameters


class GlanceParameters(Frozen):
    """Looks without a model, and the verdicts ``nearest`` and ``look``."""

    pictures: int = Field(300, ge=10, le=100_000, description="In the album of the own kind, from the side.")
    lean_deg: float = Field(
        15.0, ge=0, le=90, description="In the pictures the main body leans up to this much."
    )
    album_distance: float = Field(
        1.1, gt=0, le=10, description="Middle distance of the pictures, m: pixels blur what is small."
    )
    bandwidth: float = Field(
        0.5,
        gt=0,
        le=10,
        description="Of the kernel around each picture, in standard deviations of the album.",
    )
    silhouette: SilhouetteParameters = SilhouetteParameters()
    near: Calibration = Field(
        Calibration(bias=2.4, weights=(-2.0,)),
        description="Evidence: the distance, m. Half of the development teachers are nearer than 1.2 m.",
    )
    look: Calibration = Field(
        Calibration(bias=2.7, weights=(0.2,)),
        description="Evidence: the likeness of the looks to the album's. Fitted to 100 development teachers by "
        "logistic regression (AUC .88 there): bodies that do not move look alike.",
    )
