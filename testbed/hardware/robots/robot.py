"""What a physical robot must be able to do, whatever it is built of."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self, TypeVar

from testbed.bodies.parts import Vector
from testbed.hardware.failures import LinkLost, NotCalibrated
from testbed.hardware.line.protocol import Flags, Identity

T = TypeVar("T")


@dataclass(frozen=True)
class RobotState:
    """What a robot says about itself.

    Attributes:
        applied: (joints,) rad: what its servos are told right now; NaN where nothing goes out (limp).
        targets: (joints,) rad: where they are to end up, as clamped to the limits; NaN if nothing was commanded.
        tilt: (2,) rad to the side and nose-down, see :func:`testbed.frames.tilt_of`; None without a sensor.
        clamped: Whether the last command went beyond the limits.
        flags: What the board says about arming, watchdog, stop and sensor.
        at: When it was said, s on the bench's clock.
        acceleration: (3,) g in the body's frame; None without a sensor.
    """

    applied: Vector
    targets: Vector
    tilt: Vector | None
    clamped: bool
    flags: Flags
    at: float
    acceleration: Vector | None = field(default=None)


class Robot(Protocol):
    """A robot, as lerobot has them: connect, configure, arm, observe and act, disconnect.

    Whatever goes wrong is a :class:`~testbed.hardware.failures.HardwareFailure`. As a context manager it is limp
    and let go at the end, also after an exception and Ctrl-C.
    """

    name: str

    def connect(self) -> Identity:
        """Find it, make sure that it is the right one, and let it go limp."""
        ...

    def configure(self) -> None:
        """Tell it the limits of its calibration. It has to be disarmed."""
        ...

    def arm(self) -> None:
        """Allow it to move; nothing moves before the first :meth:`act`."""
        ...

    def observe(self) -> RobotState:
        """How it is."""
        ...

    def act(self, targets: Vector) -> RobotState:
        """Go for these joint angles (joints,) in rad; returns what was really applied."""
        ...

    def stop(self) -> None:
        """Emergency stop: limp at once, and latched."""
        ...

    def disconnect(self) -> None:
        """Limp, and let go of the port; harmless when repeated."""
        ...

    def __enter__(self) -> Self:
        """Does not connect."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnects."""
        ...


class LimpAtTheEnd:
    """As a context manager, disconnected at its end."""

    def disconnect(self) -> None:
        """Limp, and let go of the port; harmless when repeated."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        """Does not connect."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnects."""
        self.disconnect()


def connected(what: T | None, name: str) -> T:
    """What there is only of a robot that is connected.

    Raises:
        LinkLost: If it is not.
    """
    if what is None:
        raise LinkLost(f"{name} is not connected", "connect it first")
    return what


def configured(calibration: T | None, name: str) -> T:
    """The calibration of a robot that is configured.

    Raises:
        NotCalibrated: If it is not.
    """
    if calibration is None:
        raise NotCalibrated(f"{name} has not been configured", "call configure() first")
    return calibration
