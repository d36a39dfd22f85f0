"""A robot of build A: hobby servos and a tilt sensor on a microcontroller with our firmware."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbed.bodies.parts import Vector
from testbed.hardware.calibration.records import (
    ServoCalibration,
    TiltCalibration,
    check_owner,
    load_servos,
    load_tilt,
)
from testbed.hardware.clock import Clock
from testbed.hardware.failures import NotCalibrated
from testbed.hardware.line.link import LinkSpec, Listener, deaf
from testbed.hardware.line.protocol import Flags, Identity, Request, State
from testbed.hardware.robots.board import TICKS, Address, Board
from testbed.hardware.robots.robot import LimpAtTheEnd, RobotState, configured
from testbed.hardware.robots.tilt_watch import TiltSensor


@dataclass(frozen=True, kw_only=True)
class BoardSettings:
    """What a board is configured to, and what is expected of it.

    Attributes:
        slew_us: How much a pulse may change in 20 ms. A standard servo turns 60 degrees in 0.2 s, which is 60 us in
            20 ms: a faster command would only be caught up with.
        imu: Whether it carries a tilt sensor; the rig's does not.
    """

    slew_us: float = 60.0
    imu: bool = True


class ServoBoard(LimpAtTheEnd):
    """A :class:`~testbed.hardware.robots.robot.Robot` with our firmware.

    Attributes:
        board: The same in pulses.
        calibration: Of its servos, once it is configured.
        sensor: Its tilt sensor, likewise, if it has one.

    Args:
        address: Which board.
        joints: The joints' names in the order of commands.
        clock: The bench's.
        calibrations: The folder of calibrations; those of the connected board are taken from it.
        listener: Hears all frames.
        settings: What it is configured to.
        link: How patient its link is.
    """

    def __init__(
        self,
        address: Address,
        joints: Sequence[str],
        clock: Clock,
        *,
        calibrations: Path | None = None,
        listener: Listener = deaf,
        settings: BoardSettings | None = None,
        link: LinkSpec | None = None,
    ) -> None:
        self.name = address.name
        self.joints = tuple(joints)
        self.settings = settings or BoardSettings()
        self.board = Board(address, len(self.joints), clock, listener=listener, link=link)
        self.calibration: ServoCalibration | None = None
        self.sensor: TiltSensor | None = None
        self._clock, self._folder = clock, calibrations
        self._last: Vector | None = None

    def connect(self) -> Identity:
        """See :class:`Robot`; raises as :meth:`Board.connect` does."""
        self.calibration = self.sensor = self._last = None
        return self.board.connect()

    def reconnect(self) -> None:
        """See :meth:`Board.reconnect`."""
        self.board.reconnect()

    def configure(self) -> None:
        """See :class:`Robot`.

        Raises:
            NotCalibrated: If a calibration is missing or damaged.
            CalibrationForeign: If it is another board's.
        """
        identity = self.board.identity
        if self._folder is None:
            raise NotCalibrated(f"no folder of calibrations was named for {self.name}")
        servos = load_servos(self._folder, identity.unique_id, identity.board_id)
        imu = self.settings.imu
        tilt = load_tilt(self._folder, identity.unique_id, identity.board_id) if imu else None
        self.calibrate(servos, tilt)

    def calibrate(self, servos: ServoCalibration, tilt: TiltCalibration | None = None) -> None:
        """Use these calibrations and tell the board the limits.

        Raises:
            CalibrationForeign: If they are not this board's or have other joints.
        """
        for calibration in (servos, tilt):
            if calibration is not None:
                check_owner(calibration, self.board.identity.unique_id, self.board.identity.board_id)
        ordered = servos.ordered(self.joints)
        self.board.limit(ordered.limits_us, self.settings.slew_us)
        self.calibration = ordered
        self.sensor = None if tilt is None else TiltSensor(self.name, tilt)

    def arm(self) -> None:
        """See :class:`Robot`; raises as :meth:`Board.arm` does."""
        self._calibrated()
        self.board.arm()

    def observe(self) -> RobotState:
        """See :class:`Robot`.

        Raises:
            ImuMissing: If the tilt sensor does not answer.
            ImuStuck: If it repeats itself.
            TiltImplausible: If what it says cannot be.
        """
        return self._understood(self.board.ask(Request.READ))

    def act(self, targets: Vector) -> RobotState:
        """See :class:`Robot`; the board itself clamps to the limits and says so.

        Raises:
            NotArmed: If it was not armed, or disarmed meanwhile.
            WentLimp: If it was left without commands for so long that it let go.
            Stopped: If the emergency stop was pressed.
            HardwareFailure: As :meth:`observe` does.
        """
        if not np.isfinite(targets).all():
            raise ValueError(f"{self.name} cannot go for {targets}")
        pulses = self._calibrated().pulses(targets)
        if self._last is None or not np.array_equal(pulses, self._last):
            self._moved()
        self._last = pulses
        return self._understood(self.board.drive(pulses))

    def stop(self) -> None:
        """See :class:`Robot`."""
        self.board.stop()

    def disconnect(self) -> None:
        """See :class:`Robot`."""
        self.board.disconnect()

    def _calibrated(self) -> ServoCalibration:
        return configured(self.calibration, self.name)

    def _understood(self, state: State) -> RobotState:
        """A state in rad; the tilt sensor's word is weighed."""
        at, count = self._clock.now(), len(self.joints)
        pulses = np.array(state.servos[:count], dtype=float).T / TICKS
        pulses[pulses == 0] = math.nan
        calibration = self._calibrated()
        targets, applied = calibration.angles(pulses[0]), calibration.angles(pulses[1])
        if state.flags & Flags.SLEWING:
            self._moved()
        tilt, up = self.sensor.read(state, at) if self.sensor is not None else (None, None)
        clamped = bool(state.flags & Flags.CLAMPED)
        return RobotState(applied, targets, tilt, clamped, state.flags, at, up)

    def _moved(self) -> None:
        if self.sensor is not None:
            self.sensor.moved(self._clock.now())
