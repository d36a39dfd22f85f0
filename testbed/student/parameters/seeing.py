"""What the teacher modelling by ``joint_fit`` and ``embodied`` leaves open (extensions of Section 3.3)."""

from __future__ import annotations

from pydantic import Field

from testbed.frozen import Frozen


class WatchingParameters(Frozen):
    """How long the student ``like_me`` looks at a candidate before it models it (extension of Section 3.3)."""

    duration: float = Field(
        4.0,
        gt=0,
        le=600,
        description="Seconds from the first frame to the last: two strokes or more of a gait of one to two seconds.",
    )
    rate: float = Field(
        15.0, gt=0, le=1000, description="Frames a second: all that the default camera takes."
    )


class SilhouetteParameters(Frozen):
    """From luminosity to darkness; an extension of Section 3.3."""

    faint: float = Field(
        4.5,
        ge=0,
        le=20,
        description="In standard deviations of the background's noise: what is less dark than this is empty.",
    )
    brightest_share: float = Field(
        0.90,
        gt=0,
        le=1,
        description="The brightest shade of a part that is seen, as a share of the darkness of the darkest: thin "
        "parts without a fully covered pixel are compared with this.",
    )
    dark_quantile: float = Field(
        0.9,
        gt=0,
        lt=1,
        description="Quantile of the darkness of dark pixels that stands for the darkest shade.",
    )


class PosingParameters(Frozen):
    """How widely first poses are searched; an extension of Section 3.3.2."""

    places: int = Field(
        10, ge=1, le=200, description="Dark places tried for the root of a body in each frame."
    )
    rolls: int = Field(
        12, ge=2, le=72, description="Rolls of the root tried at each place, over half a turn."
    )
    angles: int = Field(24, ge=3, le=180, description="Angles tried for each limb: steps of about 8 deg.")
    kept: int = Field(6, ge=1, le=200, description="Hypotheses kept in each frame after every part.")
    steps: int = Field(
        2, ge=0, le=50, description="Improvement steps of the kept hypotheses after every part."
    )
    travel_deg: float = Field(
        95.0,
        gt=0,
        le=180,
        description="Joint angles stay within this: the paper's +-90 deg and a little tolerance.",
    )


class FittingParameters(Frozen):
    """How a body is laid into a film."""

    silhouette: SilhouetteParameters = Field(
        default_factory=SilhouetteParameters, description="From grey to darkness."
    )
    posing: PosingParameters = Field(default_factory=PosingParameters, description="First poses.")
    key_frames: int = Field(
        8, ge=1, le=200, description="Frames in which bodies are compared, spread over the film."
    )
    rounds: int = Field(
        2,
        ge=1,
        le=10,
        description="How often poses are sought from nothing; after the first, with common sizes.",
    )
    iterations: int = Field(15, ge=1, le=500, description="Steps of each bundle adjustment at most.")
    loose_best: int = Field(
        3, ge=1, le=50, description="Hypotheses of each frame whose sizes are freed in the first round."
    )
    noise: float = Field(
        0.06,
        gt=0,
        description="Variance of a pixel's coverage about the model's. Four samples a pixel leave .1 rms at edges; the "
        "rest allows for neighbours that err together, shading and outlines that are not quite mine.",
    )
    yaw_sd_deg: float = Field(
        8.0, gt=0, le=60, description="Teachers are seen from the side, within about this."
    )
    length_sd: float = Field(
        0.25,
        gt=0,
        le=2,
        description="Expected spread of the logarithm of length factors: .6 to 1.6 of the own limbs.",
    )
    thickness_sd: float = Field(0.15, gt=0, le=2, description="The same for thickness, where it is free.")
    scale_sd: float = Field(
        1.0, gt=0, le=5, description="The same for the size of the whole body: next to nothing known."
    )
    length_limits: tuple[float, float] = Field((0.5, 1.7), description="Length factors stay within these.")
    thickness_limits: tuple[float, float] = Field(
        (0.4, 1.4), description="The same for thickness, where it is free."
    )
    yaw_limit_deg: float = Field(
        35.0, gt=0, lt=90, description="The plane of motion is not turned further than this."
    )
    lost: float = Field(
        1.6,
        gt=1,
        description="A frame that is explained worse than key frames by this factor is looked at anew.",
    )
    depth_share: float = Field(
        0.02, gt=0, le=1, description="Standard error of the depth by disparity, as a share."
    )
    lengths: tuple[float, ...] = Field(
        (0.77, 1.0, 1.3), description="Length factors tried where nothing is known yet."
    )


class EmbodiedParameters(Frozen):
    """How the student compares a candidate with its own body."""

    fitting: FittingParameters = Field(
        default_factory=FittingParameters, description="How a body is laid into a film."
    )
    good: float = Field(
        0.9,
        gt=0,
        lt=1,
        description="Share explained above which alternatives start from the poses of the own body; below it they "
        "start from nothing, since those poses are worth little.",
    )
    finalists: int = Field(
        3,
        ge=1,
        le=50,
        description="Of the alternatives that start from nothing, how many are worked out to the end.",
    )
    joint_range_deg: float = Field(
        45.0,
        gt=0,
        le=180,
        description="Spread of joint angles and of the root's roll that is expected before looking.",
    )
    stranger: float = Field(
        0.35,
        gt=0,
        description="Residual that a body which is none of those considered is expected to leave, as a share of what "
        "its edges can (the sum of alpha (1 - alpha)): right bodies leave .06 to .15, wrong ones .7 and more.",
    )
    idle: float = Field(
        0.04,
        ge=0,
        lt=1,
        description="A part is not needed if leaving it out loses less than this share of the darkness: real limbs "
        "are worth .12 and more, one that hides behind others about .01.",
    )
    place_range: float = Field(0.2, gt=0, le=10, description="The same for the place of the root, m.")


class JointFitParameters(Frozen):
    """How free parts are laid into a film."""

    fitting: FittingParameters = Field(
        default_factory=FittingParameters, description="How a body is laid into a film."
    )
    trees: int = Field(2, ge=1, le=20, description="Arrangements kept as first guesses after each limb.")
    iterations: int = Field(
        10, ge=0, le=200, description="Steps in which all parts of all frames move freely."
    )
