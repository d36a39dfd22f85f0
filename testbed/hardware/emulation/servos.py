"""Hobby servos as they come out of the bag: each with a middle, a gain and a direction of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from testbed.bodies.morphology import Vector

US_PER_RAD = 1800 / math.pi
"""10 us a degree, what most servos are sold as: 180 degrees from 600 to 2400 us."""
CENTRE = 1500.0
_CENTRE_OFF = 30.0
_GAIN_OFF = 0.03
SILENCE = 0.05
"""s; a servo that has heard no pulse for two and a half frames lets go."""


@dataclass(frozen=True)
class Servo:
    """What one servo makes of a pulse.

    Attributes:
        centre: Width at which the joint is at 0, us.
        us_per_rad: How much longer a pulse is for a rad more; negative where the servo is mounted the other way round.
    """

    centre: float = CENTRE
    us_per_rad: float = US_PER_RAD

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Self:
        """One out of the bag: the horn sits where its splines let it, the gain is as good as the potentiometer.

        The errors leave 90 degrees to either side within the 500 to 2500 us that the firmware ever sends.
        """
        centre = CENTRE + rng.uniform(-_CENTRE_OFF, _CENTRE_OFF)
        gain = US_PER_RAD * (1 + rng.uniform(-_GAIN_OFF, _GAIN_OFF))
        return cls(centre, gain * rng.choice((-1.0, 1.0)))

    def angle(self, width: float) -> float:
        """Where the joint goes for pulses of this width (us), rad."""
        return (width - self.centre) / self.us_per_rad

    def width(self, angle: float) -> float:
        """The pulse (us) that brings the joint to this angle (rad)."""
        return self.centre + angle * self.us_per_rad


class Servos:
    """The servos of one board: they follow the last pulse, and let go when there are none.

    Args:
        servos: One a channel.
    """

    def __init__(self, servos: Sequence[Servo]) -> None:
        self.servos = tuple(servos)
        self._widths = [math.nan] * len(self.servos)
        self._heard = [-math.inf] * len(self.servos)

    def hear(self, at: float, channel: int, width: float) -> None:
        """A pulse of this width (us) ended at that time (s)."""
        self._widths[channel], self._heard[channel] = width, at

    def targets(self, now: float) -> Vector:
        """(n,) where the servos pull to, rad; NaN where one has let go."""
        return np.array(
            [
                servo.angle(width) if now - heard <= SILENCE else math.nan
                for servo, width, heard in zip(self.servos, self._widths, self._heard, strict=True)
            ]
        )
