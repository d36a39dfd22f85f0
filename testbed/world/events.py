"""What happens in a simulated world without anybody's action: balls are rolled, and the student's body breaks.

A new event is a class with ``reset`` and ``happen`` and one line in :func:`events_of`. Nobody is told: agents notice by
what they sense.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from testbed.morphology import Morphology, Vector
from testbed.scenario_specs import Scenario
from testbed.scenario_student import StudentSpec
from testbed.world.gaits import watched
from testbed.world.placement import Placement, teacher_names


class Stage(Protocol):
    """What events can do to a world."""

    @property
    def pan(self) -> float:
        """Where the rig looks now, rad, positive to the right."""
        ...

    def push(self, robot: str, velocity: tuple[float, float]) -> None:
        """Give a robot a velocity over the ground, m/s."""
        ...

    def lose(self, limb: str) -> None:
        """Let a limb of the student fall off."""
        ...

    def lock(self, joint: str) -> None:
        """Seize a joint of the student."""
        ...


class Event(Protocol):
    """Something that happens."""

    def reset(self) -> None:
        """An episode begins."""
        ...

    def happen(self, stage: Stage, step: int) -> None:
        """A control step begins, the ``step``-th of the episode from 0."""
        ...


class Rolling:
    """A body is rolled to and fro along its own x axis while it is watched, and held while it is not.

    Args:
        robot: Whom.
        spot: Where it starts.
        speed: In m/s.
        half: Control steps in each direction.
        always: Whether it rolls unwatched too.
    """

    def __init__(self, robot: str, spot: Placement, *, speed: float, half: int, always: bool) -> None:
        self._robot, self._spot, self._half, self._always = robot, spot, max(1, half), always
        self._velocity = speed * math.cos(spot.yaw), speed * math.sin(spot.yaw)
        self.reset()

    def reset(self) -> None:
        """An episode begins."""
        self._rolled = 0
        self._resting = True

    def happen(self, stage: Stage, step: int) -> None:
        """Pushed at each turn; held as soon as nobody looks."""
        gaze = math.remainder(stage.pan - self._spot.bearing, 2 * math.pi)
        if not self._always and not watched(gaze):
            if not self._resting:
                stage.push(self._robot, (0.0, 0.0))
            self._resting = True
            return
        if self._resting or self._rolled % self._half == 0:
            sign = -1 if (self._rolled // self._half) % 2 else 1
            stage.push(self._robot, (sign * self._velocity[0], sign * self._velocity[1]))
        self._resting = False
        self._rolled += 1


@dataclass(frozen=True)
class LimbLost:
    """A limb of the student falls off at a step."""

    limb: str
    at: int

    def reset(self) -> None:
        """Nothing to forget."""

    def happen(self, stage: Stage, step: int) -> None:
        """Once."""
        if step == self.at:
            stage.lose(self.limb)


@dataclass(frozen=True)
class JointLocked:
    """A joint of the student seizes at a step."""

    joint: str
    at: int

    def reset(self) -> None:
        """Nothing to forget."""

    def happen(self, stage: Stage, step: int) -> None:
        """Once."""
        if step == self.at:
            stage.lock(self.joint)


def events_of(scenario: Scenario, spots: Mapping[str, Placement]) -> tuple[Event, ...]:
    """All that will happen in a scenario."""
    step = scenario.world.control_step
    events: list[Event] = []
    for name, teacher in zip(teacher_names(scenario), scenario.teachers, strict=True):
        gait = teacher.gait
        if gait.kind == "push":
            half = round(gait.period / 2 / step)
            always = gait.when == "always"
            events.append(Rolling(name, spots[name], speed=gait.speed, half=half, always=always))
    damage = scenario.student.damage
    if damage is not None and damage.limb_lost is not None:
        events.append(LimbLost(damage.limb_lost, round(damage.at / step)))
    if damage is not None and damage.joint_locked is not None:
        events.append(JointLocked(damage.joint_locked, round(damage.at / step)))
    return tuple(events)


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
        if not self.offsets.any():
            return targets
        return np.clip(targets + self.offsets, self.low, self.high)
