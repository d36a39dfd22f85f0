"""What the verdicts of ``like_me`` leave open: how evidence becomes a probability."""

from __future__ import annotations

from pydantic import Field

from testbed.frozen import Frozen


class Calibration(Frozen):
    """A logistic curve: the score is ``bias + weights . evidence``, the probability 1 / (1 + exp(-score))."""

    bias: float = Field(description="Score without evidence.")
    weights: tuple[float, ...] = Field(min_length=1, description="What each piece of evidence adds.")


class LikenessParameters(Frozen):
    """Section 3.4 and its extensions: from what was found to a verdict with a probability."""

    controller: Calibration = Field(
        Calibration(bias=-16.2, weights=(20.0,)),
        description="Evidence: the rehearsal's score, the share of the motion that is the student's own. Measured on "
        "120 development verdicts (scenario verdict, cell all, seed 7): the lowest of a teacher like the student is "
        ".85 and the highest of another .81 with the embodied model.",
    )
    attachment: Calibration = Field(
        Calibration(bias=-7.2, weights=(2.1, 2.1, 1.6)),
        description="Evidence: minus the logarithm of the widest gap between parts that should hang together, in limb "
        "lengths; the logarithm of the least turning (rad) of a joint; minus the logarithm of the share of what was "
        "seen that the parts leave unexplained. Fitted to 100 development teachers by ridge-regularised logistic "
        "regression (AUC 1 there).",
    )
    likelihood: Calibration = Field(
        Calibration(bias=3.3, weights=(3.0,)),
        description="Evidence: asinh(r / 10) of the logarithm r of how much more probable the own body is than the "
        "best other. Measured on the same 120 verdicts: r is at least -7 for teachers like the student, for a box that "
        "is far away looks thin, and at most -22 for others. These two get a probability of .8 and of .2.",
    )
