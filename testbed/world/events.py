"""What happens in a simulated world without anybody's action: balls roll, teachers leave, the student's body breaks.

A new event is a class with ``reset`` and ``happen`` and one line in :func:`events_of`. Nobody is told: agents notice by
what they sense.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from testbed.bodies.morphology import Morphology, Sphere
from testbed.scenario.specs import Scenario
from testbed.world.attention import Occasion, occasion_of
from testbed.world.placement import STUDENT, Placement, teacher_names


class Stage(Protocol):
    """What events can do to a world."""

    @property
    def pan(self) -> float:
        """Where the rig looks now, rad, positive to the right."""
        ...

    def movement(self, robot: str) -> float:
        """How fast a robot's fastest limb turned in the last control step, rad/s."""
        ...

    def push(self, robot: str, velocity: tuple[float, float]) -> None:
        """Give a robot a velocity over the ground, m/s."""
        ...

    def remove(self, robot: str) -> None:
        """Keep a robot out of sight for this step."""
        ...

    def bring_back(self, robot: str) -> None:
        """Put a robot that was out of sight back to where it was."""
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


class Pushed:
    """A body is pushed to and fro along its own x axis while there is an occasion, and held while there is none.

    Args:
        robot: Whom.
        spot: Where it starts.
        speed: In m/s.
        half: Control steps in each direction.
        rolls: Whether it rolls on by itself between two turns; what does not is pushed at every step.
        occasion: When it moves.
    """

    def __init__(
        self, robot: str, spot: Placement, *, speed: float, half: int, rolls: bool, occasion: Occasion
    ) -> None:
        self._robot, self._spot, self._half, self._rolls = robot, spot, max(1, half), rolls
        self._velocity = speed * math.cos(spot.yaw), speed * math.sin(spot.yaw)
        self._occasion = occasion
        self.reset()

    def reset(self) -> None:
        """An episode begins."""
        self._occasion.reset()
        self._pushed = 0
        self._resting = True

    def happen(self, stage: Stage, step: int) -> None:
        """Pushed at each turn, or all the time; held as soon as the occasion is over."""
        gaze = math.remainder(stage.pan - self._spot.bearing, 2 * math.pi)
        sensed = {"gaze": np.array([gaze]), "movement": np.array([stage.movement(STUDENT)])}
        if not self._occasion.calls(sensed):
            if not self._resting:
                stage.push(self._robot, (0.0, 0.0))
            self._resting = True
            return
        if self._resting or not self._rolls or self._pushed % self._half == 0:
            sign = -1 if (self._pushed // self._half) % 2 else 1
            stage.push(self._robot, (sign * self._velocity[0], sign * self._velocity[1]))
        self._resting = False
        self._pushed += 1


@dataclass(frozen=True)
class Away:
    """A teacher is out of sight for a while, and then where it was before; spans are steps, the last one excluded."""

    robot: str
    spans: tuple[tuple[int, int], ...]

    def reset(self) -> None:
        """Nothing to forget."""

    def happen(self, stage: Stage, step: int) -> None:
        """It leaves, stays away, returns."""
        if any(leaves <= step < returns for leaves, returns in self.spans):
            stage.remove(self.robot)
        elif any(step == returns for _, returns in self.spans):
            stage.bring_back(self.robot)


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


def events_of(
    scenario: Scenario, spots: Mapping[str, Placement], bodies: Mapping[str, Morphology]
) -> tuple[Event, ...]:
    """All that will happen in a scenario to bodies that stand on these spots."""
    rolling = {name for name, body in bodies.items() if isinstance(body.parts[body.root], Sphere)}
    step = scenario.world.control_step
    events: list[Event] = []
    for name, teacher in zip(teacher_names(scenario), scenario.teachers, strict=True):
        gait = teacher.gait
        if gait.kind == "push":
            events.append(
                Pushed(
                    name,
                    spots[name],
                    speed=gait.speed / gait.stretched,
                    half=round(gait.period * gait.stretched / 2 / step),
                    rolls=name in rolling,
                    occasion=occasion_of(gait, step),
                )
            )
        if teacher.away:
            spans = tuple((round(leaves / step), round(returns / step)) for leaves, returns in teacher.away)
            events.append(Away(name, spans))
    damage = scenario.student.damage
    if damage is not None and damage.limb_lost is not None:
        events.append(LimbLost(damage.limb_lost, round(damage.at / step)))
    if damage is not None and damage.joint_locked is not None:
        events.append(JointLocked(damage.joint_locked, round(damage.at / step)))
    return tuple(events)
