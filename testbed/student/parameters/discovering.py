"""What the self-discovery ``active`` and the check for damage leave open (extensions of Section 3.2)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from testbed.bodies.morphology import Vector
from testbed.frozen import Frozen
from testbed.student.body.commands import CommandParameters


class PlausibilityParameters(Frozen):
    """What the student believes about its sensor, its servos and its parts."""

    tilt_noise_deg: float = Field(
        0.5, gt=0, le=45, description="Standard deviation of a tilt reading: the testbed's default sensor."
    )
    model_error_deg: float = Field(
        0.3,
        ge=0,
        le=45,
        description="The same of what the settle solver leaves out: contact depth, densities, servos that give.",
    )
    bias_deg: float = Field(
        1.0, gt=0, le=45, description="Standard deviation of a constant error of the tilt sensor, co-fitted."
    )
    offset_deg: float = Field(
        3.0, gt=0, le=45, description="Standard deviation of what a servo adds to its commands, co-fitted."
    )
    stretch: float = Field(
        0.07, gt=0, le=0.5, description="Relative standard deviation of a limb's length, co-fitted."
    )
    freedom: float = Field(
        2.0,
        gt=0,
        le=100,
        description="Degrees of freedom of Student's t: how heavy the tail is. About one posture in twenty ends "
        "elsewhere than foreseen.",
    )

    in_place: bool = Field(
        False,
        description="Whether a body explains a reading if it would stay where it was felt to lie, however it came to "
        "lie there. If not, it must come there slowly from lying level: more is foreseen, but with three limbs and "
        "more swift motions throw one posture in five over into another way to lie, and a body may be on its back.",
    )

    @property
    def spread(self) -> float:
        """Scale of a residual, rad."""
        return float(np.radians(np.hypot(self.tilt_noise_deg, self.model_error_deg)))

    def prior_widths(self, limbs: int) -> Vector:
        """(3 n,) standard deviations of a genome's values; infinite for mounting angles."""
        return np.repeat([np.inf, np.radians(self.offset_deg), self.stretch], limbs)


class ActiveDiscoveryParameters(Frozen):
    """Everything open about the active self-discovery."""

    commands: int = Field(10, ge=1, le=1000, description="As many as the paper's (Section 3.2.1).")
    evaluations: int = Field(
        2000,
        ge=100,
        description="Self-models imagined in all, however many commands each: choosing commands, search, posterior. "
        "Spread evenly over the commands.",
    )
    outward: bool = Field(
        True,
        description="Motors are numbered from the main body outward: a limb hangs on the main body or on a limb before "
        "it, as limb b in the paper's genome (n! topologies for n limbs). If not, on any: (n + 1)^(n - 1).",
    )
    population: int = Field(40, ge=4, le=1000, description="Self-models kept from one command to the next.")
    per_tree: int = Field(
        2, ge=1, le=100, description="Of each topology at least so many, as long as there is room for all."
    )
    voters: int = Field(12, ge=2, le=100, description="Self-models that choose a command: eight to sixteen.")
    pool: int = Field(40, ge=1, le=1000, description="Commands that they choose from.")
    voter_freedom: float = Field(
        6.0,
        ge=1,
        description="Votes are tempered until this many voters count: early on the likeliest is seldom right.",
    )
    distinct_deg: float = Field(
        8.0, gt=0, description="Two self-models of one topology differ by at least this in some angle."
    )
    runners_up: int = Field(
        8,
        ge=1,
        le=100,
        description="Commands of the pool that are tried with small changes, four times each.",
    )
    nudge_deg: float = Field(
        0.0,
        ge=0,
        lt=45,
        description="If above zero, expectations count less where joints that are so much off would tilt the body "
        "otherwise; that costs as much again as choosing. Bodies with many limbs lie on a knife's edge more often.",
    )
    widest_deg: float = Field(
        30.0, gt=0, le=180, description="No voter is drawn further than this from its self-model (1 sigma)."
    )
    simplest_deg: float = Field(
        90.0,
        ge=0,
        le=360,
        description="A prior: among angles that are as plausible as one another a multiple of this is preferred, for "
        "builders like right angles; 0 leaves it out. The paper's own student (0, 0) sits in the fold where tilt says "
        "nothing, and without this prior its angles stay unknown within some 20 deg.",
    )
    final_share: float = Field(
        0.15, ge=0, lt=1, description="Evaluations that are kept for the posterior at the end."
    )
    openings: int = Field(
        1,
        ge=0,
        le=5,
        description="First every joint pushes down alone, so many times: what is felt then depends on few unknowns.",
    )
    exploring: float = Field(
        0.5,
        ge=0,
        le=1,
        description="Share of the search that draws new self-models; the rest improves the best.",
    )
    scans: int = Field(
        0,
        ge=0,
        le=100,
        description="In each round, how many times a limb of one of the best self-models is hung everywhere: worth its "
        "price when there are many limbs.",
    )
    rounds: int = Field(2, ge=1, le=50, description="Rounds of drawing and improving after each command.")
    elite: float = Field(
        10.0, gt=0, description="Roughly how many of the best self-models have most of the offspring."
    )
    late: bool = Field(
        False,
        description="Whether the search grows with the number of commands told, or is the same after each.",
    )
    modes: int = Field(
        10,
        ge=1,
        le=100,
        description="Self-models around which the posterior is drawn, all within 12 nats of the best.",
    )
    middle_within: float = Field(
        2.5,
        ge=0,
        description="The mean of the likeliest group is taken for the body if it is less plausible than the best by no "
        "more than this (nats): where the tilt hardly depends on an angle, the best is anywhere.",
    )
    fewest_samples: int = Field(
        100, ge=10, description="Bodies drawn for the posterior where no more evaluations are left."
    )
    most_samples: int = Field(
        2000,
        ge=10,
        description="Never more than this: grouping them takes time that grows with their square.",
    )
    known_within_deg: float = Field(
        10.0, gt=0, description="An angle is known if the posterior keeps within this of the best ..."
    )
    known_share: float = Field(0.95, gt=0, le=1, description="... with this share of its bodies.")
    choice: CommandParameters = CommandParameters()
    beliefs: PlausibilityParameters = PlausibilityParameters()

    @classmethod
    def for_limbs(cls, limbs: int) -> ActiveDiscoveryParameters:
        """Defaults that grow with the body: n limbs have n! topologies, and rest on more things at once.

        With three limbs 20 commands and 6,000 evaluations; with more 40 and 40,000, most of them late and spent on
        hanging single limbs everywhere: measured on a quadruped with eight joints, the right topology of 40,320.
        """
        if limbs <= 2:
            return cls()
        if limbs == 3:
            return cls(commands=20, evaluations=6000, beliefs=PlausibilityParameters(in_place=True))
        return cls(
            commands=40,
            evaluations=40_000,
            final_share=0.03,
            elite=5.0,
            openings=0,
            nudge_deg=2.0,
            exploring=0.15,
            scans=2,
            late=True,
            choice=CommandParameters(lift_share=0.6),
            beliefs=PlausibilityParameters(model_error_deg=1.0, in_place=True),
        )


class DamageParameters(Frozen):
    """Everything open about noticing damage."""

    bodies: int = Field(
        6, ge=1, le=100, description="Bodies of the posterior with which every hypothesis is followed."
    )
    locked_angles: int = Field(
        13, ge=1, le=181, description="Angles, evenly over the travel, at which a joint may be locked."
    )
    hazard: float = Field(
        0.02,
        gt=0,
        lt=0.5,
        description="Chance that something breaks before a command; the same for every joint.",
    )
    alarm: float = Field(
        0.9, gt=0, lt=1, description="Damage is noticed when it is this probable: nine to one."
    )
    design_share: float = Field(
        0.5,
        gt=0,
        lt=1,
        description="Commands are chosen as if damage were at least this probable, or nothing would be asked.",
    )
    pool: int = Field(60, ge=1, le=1000, description="Commands to choose from.")
    outlier: float = Field(
        0.05,
        gt=0,
        lt=0.5,
        description="Share of postures that end elsewhere than foreseen, whatever the hypothesis; they are no reason "
        "for alarm.",
    )
    commands: CommandParameters = CommandParameters()


class RediscoveryParameters(Frozen):
    """Everything open about how the student models itself anew once it has noticed damage."""

    commands: int = Field(
        8,
        ge=1,
        le=1000,
        description="Further commands: about as many as the paper's first self-discovery (Section 3.2.1).",
    )
    bodies: int = Field(
        80,
        ge=4,
        le=10_000,
        description="Samples of each supposition: enough that some joint among them is stuck within a degree.",
    )
    moves: int = Field(2, ge=1, le=100, description="Steps of every sample at each degree of a reading.")
    voters: int = Field(
        16,
        ge=4,
        le=1000,
        description="Samples that choose a command: eight to sixteen, as in self-discovery.",
    )
    design_share: float = Field(
        0.5,
        gt=0,
        lt=1,
        description="Voters for other suppositions than the likeliest: as long as they have a say, what is wrong is "
        "found out; the others refine the likeliest.",
    )
    pool: int = Field(60, ge=1, le=1000, description="Commands to choose from.")
    doubt: float = Field(
        0.05, gt=0, lt=1, description="What is as probable as this at the end is told as another possibility."
    )
    choice: CommandParameters = CommandParameters()


class SelfCheckParameters(Frozen):
    """Before it moves, the student ``like_me`` makes sure that its body is still what it was (extension)."""

    checks: int = Field(
        3,
        ge=0,
        le=1000,
        description="Commands that it tries; 0 leaves the check out. Three show nearly all damage that shows at all.",
    )
    damage: DamageParameters = DamageParameters()
    anew: RediscoveryParameters | None = Field(
        RediscoveryParameters(), description="None: what was noticed is believed as it is."
    )
