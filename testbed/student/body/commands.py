"""Which motor commands are worth trying on oneself: those that press the ground, and about which opinions differ."""

from __future__ import annotations

import math

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from testbed.bodies.morphology import Vector


class CommandParameters(BaseModel):
    """How commands are drawn, and how far an expectation about them is trusted."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    push_share: float = Field(
        0.7,
        ge=0,
        le=1,
        description="Joints in proposed commands that push down: pushing up moves nothing unless the body topples.",
    )
    lift_share: float = Field(
        0.3,
        ge=0,
        le=1,
        description="Commands that lift all other joints out of the way: what is felt then does not depend on limbs "
        "that lie on the ground, of which there are many with more than two.",
    )
    margin_deg: float = Field(
        6.0,
        ge=0,
        lt=45,
        description="Commands keep off the ends of the travel, which an offset would run into.",
    )
    calm: float = Field(
        0.3,
        gt=0,
        le=1,
        description="How much faster than its fastest motor a voter may roll before its vote halves: of the postures "
        "reached without haste 0.4% end elsewhere than foreseen, of the hastier ones 10 to 60%.",
    )
    steep_deg: float = Field(
        45.0,
        gt=0,
        le=180,
        description="A voter that would be tilted more is heard less, by the factor above: from 60 deg on 30% of the "
        "postures end elsewhere.",
    )

    def travel(self, limits: Vector) -> tuple[Vector, Vector]:
        """Smallest and greatest commands (n,) within motor limits (n, 2), rad."""
        margin = math.radians(self.margin_deg)
        return limits[:, 0] + margin, limits[:, 1] - margin

    def draw(
        self, limits: Vector, count: int, rng: np.random.Generator, *, alone: int | None = None
    ) -> Vector:
        """(count, n) commands, rad: some joints move, mostly downward; the others stay flat or are all lifted.

        Args:
            limits: (n, 2) travel of the motors, rad.
            count: How many.
            rng: Source of chance.
            alone: If given, the one joint that moves, downward.
        """
        low, high = self.travel(limits)
        shape = (count, len(low))
        down = rng.uniform(np.clip(math.radians(15), low, high), high, shape)
        aside = rng.uniform(low, np.clip(math.radians(-40), low, high), shape)
        aside = np.where(rng.random((count, 1)) < self.lift_share, aside, 0.0)
        if alone is not None:
            return np.where(np.arange(len(low)) == alone, down, aside)
        any_way = rng.uniform(low, high, shape)
        commands = np.where(rng.random(shape) < self.push_share, down, any_way)
        moving = rng.random(shape) < rng.uniform(0.3, 1.0, (count, 1))
        moving[np.arange(count), rng.integers(len(low), size=count)] = True
        return np.where(moving, commands, aside)

    def near(self, commands: Vector, limits: Vector, rng: np.random.Generator) -> Vector:
        """The same commands, a little otherwise; what does not move goes on not moving."""
        moved = commands + rng.normal(0.0, math.radians(12.0), commands.shape)
        return np.where(commands == 0.0, 0.0, np.clip(moved, *self.travel(limits)))


def worth_of(
    votes: Vector, ups: Vector, haste: Vector, spread: float, parameters: CommandParameters
) -> Vector:
    """(m,) how much the outcome of each command tells: how far expectations lie apart, in units of the sensor's spread.

    Args:
        votes: (v,) how much each expectation counts.
        ups: (v, m, 3) the expected up directions.
        haste: (v, m) how hastily the body would get there.
        spread: Scale of a residual, rad.
        parameters: How far hasty and steep expectations are trusted.
    """
    firm = 1 / (1 + (np.maximum(0.0, haste - 1.0) / parameters.calm) ** 2)
    firm *= np.where(ups[:, :, 2] < math.cos(math.radians(parameters.steep_deg)), parameters.calm, 1.0)
    heard = votes[:, None] * firm
    worth = np.zeros(ups.shape[1])
    for voice, where in zip(heard, ups, strict=True):
        apart = np.sum((ups - where) ** 2, axis=2)
        worth += voice * np.einsum("vm,vm->m", heard, np.log1p(apart / (2 * spread**2)))
    return worth
