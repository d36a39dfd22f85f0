"""The tilt sensor of a body on the ground: what it says, and whether that can be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.bodies.parts import Vector
from testbed.hardware.calibration.records import TiltCalibration, tilt_from
from testbed.hardware.failures import ImuMissing, ImuStuck, TiltImplausible
from testbed.hardware.line.protocol import NO_IMU_AGE, Flags, State


@dataclass(frozen=True, kw_only=True)
class TiltWatchSpec:
    """What is believed.

    Attributes:
        least: g; a body on the ground feels 1 on average, and less or more only in jerks ...
        most: ... so that most readings lie between these two.
        patience: How many more readings outside than inside are borne; ten are a third of a second.
        oldest_ms: The firmware reads the sensor every 5 ms.
        jump_deg: What turns further between two readings while nothing moves is no body.
        still: Seconds without a command that moves something after which a body is at rest.
    """

    least: float = 0.5
    most: float = 1.5
    patience: int = 10
    oldest_ms: int = 100
    jump_deg: float = 45.0
    still: float = 1.0


class TiltWatch:
    """Looks at one sensor's readings, one after the other.

    Args:
        name: Whose sensor, for the message.
        spec: What is believed.
    """

    def __init__(self, name: str, spec: TiltWatchSpec | None = None) -> None:
        self._name = name
        self._spec = spec or TiltWatchSpec()
        self._moved = -math.inf
        self._last: tuple[float, Vector] | None = None
        self._outside = 0

    def moved(self, at: float) -> None:
        """At this time (s) something was told to move."""
        self._moved = at

    def look(self, acceleration: Vector, at: float) -> None:
        """A reading (3,) g.

        Raises:
            TiltImplausible: If it cannot be.
        """
        spec, size = self._spec, float(np.linalg.norm(acceleration))
        outside = not spec.least <= size <= spec.most
        self._outside = max(0, self._outside + (1 if outside else -1))
        if self._outside >= spec.patience:
            felt = f"it feels {size:.2f} g, at rest it should be 1"
            raise TiltImplausible(f"the tilt sensor of {self._name} cannot be right: {felt}")
        if outside:
            return
        direction = acceleration / size
        if self._last is not None and self._last[0] - self._moved > spec.still:
            turned = math.degrees(math.acos(np.clip(direction @ self._last[1], -1.0, 1.0)))
            if turned > spec.jump_deg:
                jump = f"it jumped by {turned:.0f} degrees while nothing moved"
                raise TiltImplausible(f"the tilt sensor of {self._name} cannot be right: {jump}")
        self._last = (at, direction)


class TiltSensor:
    """Understands the sensor's part of a board's state.

    Args:
        name: Whose sensor.
        calibration: How it sits on the body.
        spec: What is believed.
    """

    def __init__(self, name: str, calibration: TiltCalibration, spec: TiltWatchSpec | None = None) -> None:
        self._name = name
        self._calibration = calibration
        self._spec = spec or TiltWatchSpec()
        self._watch = TiltWatch(name, self._spec)

    def moved(self, at: float) -> None:
        """At this time (s) something was told to move."""
        self._watch.moved(at)

    def read(self, state: State, at: float) -> tuple[Vector, Vector]:
        """(2,) tilt in rad and (3,) acceleration in g, in the body's frame.

        Raises:
            ImuMissing: If the sensor does not answer its board.
            ImuStuck: If it repeats itself.
            TiltImplausible: If what it says cannot be.
        """
        missing = state.imu_age_ms == NO_IMU_AGE or state.imu_age_ms > self._spec.oldest_ms
        if missing or state.flags & Flags.IMU_MISSING:
            raise ImuMissing(f"the tilt sensor of {self._name} does not answer")
        if state.flags & Flags.IMU_STUCK:
            raise ImuStuck(f"the tilt sensor of {self._name} repeats one reading to the bit")
        acceleration = self._calibration.acceleration(state.acceleration)
        self._watch.look(acceleration, at)
        return tilt_from(acceleration), acceleration
