"""What is wrong with the student's servos and its tilt sensor: the part of the reality gap that is no body's."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.scenario.student import StudentSpec


@dataclass(frozen=True)
class Flaws:
    """What is wrong with the student's servos and its tilt sensor.

    Attributes:
        offsets: (joints,) rad: how much further each joint turns than commanded.
        low: (joints,) rad: how far it can turn up ...
        high: ... and down.
        tilt_bias: (2,) rad: what the sensor adds.
    """

    offsets: Vector
    low: Vector
    high: Vector
    tilt_bias: Vector

    @classmethod
    def of(cls, student: StudentSpec, body: Morphology) -> Self:
        """Those of a concrete scenario's student; none where the scenario states none."""
        gap = student.reality_gap
        offsets = gap.servo_offset_deg if gap is not None else 0.0
        bias = gap.tilt_bias_deg if gap is not None else 0.0
        low, high = body.limits.T
        return cls(
            offsets=np.radians(offsets) if isinstance(offsets, tuple) else np.zeros(len(body.joints)),
            low=low,
            high=high,
            tilt_bias=np.radians(bias) if isinstance(bias, tuple) else np.zeros(2),
        )

    def turned(self, targets: Vector) -> Vector:
        """Where the servos turn to (rad) when they are told to turn to ``targets``."""
        if not self._turns_elsewhere:
            return targets
        return np.clip(targets + self.offsets, self.low, self.high)

    @cached_property
    def _turns_elsewhere(self) -> bool:
        return bool(self.offsets.any())


class Lag:
    """Servos that are late: what each was told some control steps ago is what it hears now.

    Args:
        steps: (joints,) how many control steps each is late.
    """

    def __init__(self, steps: NDArray[np.int_]) -> None:
        self._steps = steps
        self._late = bool(steps.any())
        self.reset()

    @classmethod
    def of(cls, student: StudentSpec, body: Morphology, control_step: float) -> Self:
        """That of a concrete scenario's student; none where the scenario states none."""
        gap = student.reality_gap
        lag = gap.servo_lag if gap is not None else 0.0
        seconds = np.array(lag) if isinstance(lag, tuple) else np.zeros(len(body.joints))
        return cls(np.rint(seconds / control_step).astype(int))

    def reset(self) -> None:
        """An episode begins: nothing was said yet."""
        self._told: deque[Vector] = deque(maxlen=int(self._steps.max(initial=0)) + 1)

    def heard(self, targets: Vector) -> Vector:
        """What the servos hear (rad) in the step in which they are told ``targets``; at first the earliest words."""
        self._told.append(targets)
        if not self._late:
            return targets
        last = len(self._told) - 1
        return np.array([self._told[last - min(late, last)][joint] for joint, late in enumerate(self._steps)])
