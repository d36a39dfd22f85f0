"""What the imitation ``rehearsed`` and performing leave open (extensions of Section 3.4)."""

from __future__ import annotations

from pydantic import Field, model_validator

from testbed.frozen import Frozen


class HarmonicsParameters(Frozen):
    """What counts as a rhythm. Extension of Section 3.4.1."""

    shortest_period: float = Field(
        0.6, gt=0, le=60, description="s; a servo of 300 deg/s swings 2 x 40 deg to and fro in 0.6 s."
    )
    longest_share: float = Field(
        0.9,
        gt=0,
        le=1,
        description="A period is at most this share of what was seen: some of it must have been seen twice.",
    )
    most_harmonics: int = Field(
        4, ge=1, le=12, description="Sines a roll; a triangle or trapezoid is told from a sine by its third."
    )
    penalty: float = Field(
        1.5,
        gt=0,
        le=20,
        description="Weight of the information criterion (1: BIC) against one more harmonic or a multiple of the "
        "period. Neighbouring frames err alike, so that they tell less than their number.",
    )
    periods_an_octave: int = Field(
        24, ge=4, le=1000, description="How finely periods are tried before the best are refined."
    )
    outlier: float = Field(
        2.5,
        gt=0,
        le=20,
        description="Frames further off than this many robust deviations count less (Huber).",
    )
    rhythm: float = Field(
        0.7,
        ge=0,
        le=1,
        description="Less of the variance explained by the harmonics is no rhythm: the motion is smoothed instead. "
        "A swing of 15 deg seen with 3 deg of noise still has 0.92.",
    )
    smoothing: float = Field(
        0.12,
        gt=0,
        le=10,
        description="s; width of the kernel that smooths a motion without a rhythm: two frames.",
    )


class RehearsalParameters(Frozen):
    """Section 3.4 and its extension: how the controller is searched and judged."""

    samples: int = Field(
        48,
        ge=8,
        le=1000,
        description="Moments of the motion that the self-model is tried at: twelve a second of a look of 4 s. "
        "Section 3.4.1 has 240, one a control step.",
    )
    restarts: int = Field(
        5,
        ge=2,
        le=100,
        description="Starts of the search: random weights as in Section 3.4.2, and the closed form.",
    )
    steps: int = Field(
        6, ge=0, le=1000, description="Damped least-squares steps from each start; most end within four."
    )
    climbing: int = Field(
        40, ge=0, le=10_000, description="Hill-climbing mutations of the best weights afterwards."
    )
    initial_weight: float = Field(1.0, gt=0, description="Section 3.4.2: weights start within -1 and 1.")
    weight_width: float = Field(
        0.1, gt=0, description="Standard deviation of a mutation of a weight: polish, not search."
    )
    poses: int = Field(
        12, ge=1, le=1000, description="Moments at which the positions of parts decide the correspondence."
    )
    readings: int = Field(
        1,
        ge=1,
        le=1000,
        description="How many readings of the teacher (side and correspondence) are tried, the nearest first; the "
        "best response wins. With one, the paper's, all of 80 development crawlers were read right; with all of them "
        "one in 80 was taken for one with its limbs swapped, which makes nearly the same rolls and goes nowhere.",
    )
    still_deg: float = Field(
        3.0,
        gt=0,
        le=45,
        description="A roll or joint that moves less than this (rms deg) could as well stand still: it is what eyes "
        "err by.",
    )
    proportions: tuple[float, float] = Field(
        (0.5, 2.0),
        description="The self-model that rehearses takes the teacher's proportions: its limbs grow by factors in this "
        "range. A body with longer limbs tips over at other angles, but is joined alike; (1, 1) for never. Measured on "
        "development crawlers with limbs of 0.7 to 1.3: the lowest score rises from .73 to .84.",
    )
    misplacement_weight: float = Field(
        1.0,
        ge=0,
        le=100,
        description="How much the distance of parts from where the student's own would be counts against the motion. "
        "A limb that is left out of the teacher model leaves a gap. Measured on 160 development teachers with true "
        "rolls: AUC .991, against .973 without.",
    )
    unexplained_weight: float = Field(
        1.0,
        ge=0,
        le=100,
        description="How much it counts against the motion that the teacher model leaves some of what was seen "
        "unexplained: a fourth part among three objects. What is not modelled is not imitated. Measured on 80 "
        "development crawlers and 80 others seen by ``joint_fit``: AUC 1.000 (lowest crawler .83, highest other .74), "
        "against .999 without.",
    )
    harmonics: HarmonicsParameters = HarmonicsParameters()

    @model_validator(mode="after")
    def _around_one(self) -> RehearsalParameters:
        low, high = self.proportions
        if not 0.1 <= low <= 1 <= high <= 10:
            raise ValueError("proportions must be two factors between 0.1 and 10, around 1")
        return self


class PerformingParameters(Frozen):
    """How the student performs. Extension: the paper plays the 240 commands of the rehearsal once."""

    cycles: float = Field(
        4.0, gt=0, le=10_000, description="How many periods of the teacher's rhythm are performed."
    )
    seconds: float = Field(
        8.0, gt=0, le=3600, description="s; longest performance, and that of a motion without a rhythm."
    )
    ramp: float = Field(
        0.6,
        ge=0,
        le=60,
        description="s from lying flat to the first posture: a servo takes 0.3 s for 90 deg.",
    )
    practice: int = Field(
        60,
        ge=0,
        le=10_000,
        description="Mutations of the controller that are practised in the physical imagination before the student "
        "performs; 0.1 s each.",
    )
    practice_cycles: float = Field(
        2.0, gt=0, le=100, description="Periods that are imagined each time; the first settles down."
    )
    practice_width: float = Field(
        0.1, gt=0, description="Standard deviation of a mutation at first; it grows with success."
    )
    roll_tolerance_deg: float = Field(
        3.0, gt=0, description="An rms error of rolls as bad as ``travel_tolerance``: what eyes err by."
    )
    travel_tolerance: float = Field(
        0.1,
        gt=0,
        description="How far off, as a share of the teacher's, the distance travelled may be: what is the gait for? "
        "Rolls alone leave the student at 0.86 of it, for a logistic unit flattens the ends of a swing.",
    )
    longest_lag: float = Field(
        0.25, gt=0, le=5, description="s; slower servos than this are taken for stuck, not for lagging."
    )
