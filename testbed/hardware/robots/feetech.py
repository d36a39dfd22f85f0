"""A robot of build B: Feetech STS3215 bus servos, and a board of build A beside them that only feels the tilt.

These servos have no watchdog: when the cable is pulled they hold where they are, with all their strength. They are
limp after :meth:`FeetechRobot.disconnect`, an exception and Ctrl-C; for everything else there is the physical
power-cut.
"""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbed.bodies.parts import Vector
from testbed.errors import UserError
from testbed.hardware.calibration.records import ServoCalibration, check_owner, load_servos, load_tilt
from testbed.hardware.clock import Clock
from testbed.hardware.failures import (
    NotArmed,
    NotCalibrated,
    PortMissing,
    Stopped,
)
from testbed.hardware.line.bus import BUS_BAUD, FeetechLine, Register
from testbed.hardware.line.handshake import is_usb_serial
from testbed.hardware.line.link import LinkSpec, LinkStatistics, Listener, deaf
from testbed.hardware.line.ports import found_ports, open_port
from testbed.hardware.line.protocol import PROTOCOL, Flags, Identity, Request
from testbed.hardware.robots.board import Address, Board
from testbed.hardware.robots.bus_servo import BusSettings, ServoReading, check_model, read_servo
from testbed.hardware.robots.robot import LimpAtTheEnd, RobotState, configured, connected
from testbed.hardware.robots.tilt_watch import TiltSensor


def adapter_path(address: Address) -> str:
    """The port of a bus's adapter, which is known by its USB serial number.

    Raises:
        PortMissing: If it is nowhere.
    """
    if address.port is not None:
        return address.port
    for port in found_ports(address.globs):
        if is_usb_serial(port, address.unique_id or ""):
            return port.path
    raise PortMissing(f"the adapter {address.unique_id} of {address.name} is not there")


def calibrated_as(address: Address, servos: Iterable[int]) -> str:
    """What the calibration of a bus is kept under: its adapter's serial number, or the numbers of its servos."""
    return address.unique_id or f"bus-{'-'.join(map(str, servos))}"


class FeetechRobot(LimpAtTheEnd):
    """A :class:`~testbed.hardware.robots.robot.Robot` of bus servos.

    Its calibration is a :class:`~testbed.hardware.calibration.records.ServoCalibration` in ticks, kept under the USB
    serial number of its adapter (``unique_id``), that of its tilt sensor under the id of the board that carries it.

    Args:
        address: The adapter.
        servos: By joint, in the order of commands: the servo's number on the bus.
        clock: The bench's.
        imu: The board with the tilt sensor, if there is one.
        calibrations: The folder of calibrations.
        listener: Hears all that is sent and received.
        settings: How the servos are driven.
        link: How patient the line is.
    """

    def __init__(
        self,
        address: Address,
        servos: Mapping[str, int],
        clock: Clock,
        *,
        imu: Address | None = None,
        calibrations: Path | None = None,
        listener: Listener = deaf,
        settings: BusSettings | None = None,
        link: LinkSpec | None = None,
    ) -> None:
        self.name = address.name
        self.joints = tuple(servos)
        self.settings = settings or BusSettings()
        self.calibration: ServoCalibration | None = None
        self.sensor: TiltSensor | None = None
        self.imu = Board(imu, 0, clock, listener=listener) if imu is not None else None
        self._address, self._ids, self._clock = address, tuple(servos.values()), clock
        self._folder, self._listener, self._spec = calibrations, listener, link
        self._line: FeetechLine | None = None
        self._armed = self._stopped = False
        self._last: tuple[int, ...] | None = None

    @property
    def statistics(self) -> LinkStatistics:
        """Of the bus since it was opened."""
        return self._linked.statistics

    @property
    def unique_id(self) -> str:
        """What its calibration is kept under."""
        return calibrated_as(self._address, self._ids)

    def connect(self) -> Identity:
        """See :class:`Robot`.

        Raises:
            NoAnswer: If a servo does not answer.
            WrongBoard: If it is no STS3215.
        """
        self.disconnect()
        self.calibration = self.sensor = self._last = None
        self._stopped = False
        port = open_port(adapter_path(self._address), baud=BUS_BAUD)
        self._line = FeetechLine(port, self._clock, name=self.name, listener=self._listener, spec=self._spec)
        try:
            for servo in self._ids:
                check_model(self._line, servo)
            self._relax()
            sensor = self.imu.connect() if self.imu is not None else None
        except BaseException:
            self.disconnect()
            raise
        blank = Identity(PROTOCOL, (1, 0, 0), "", "", 0, 0, 0, (), 0, 0, 0)
        limits = tuple((0, 4095) for _ in self._ids)
        return replace(sensor or blank, board_id=self.name, unique_id=self.unique_id, limits=limits)

    def configure(self) -> None:
        """See :class:`Robot`."""
        if self._folder is None:
            raise NotCalibrated(f"no folder of calibrations was named for {self.name}")
        self.calibrate(load_servos(self._folder, self.unique_id))
        if self.imu is not None:
            found = self.imu.identity
            tilt = load_tilt(self._folder, found.unique_id, found.board_id)
            self.sensor = TiltSensor(self.name, tilt)

    def calibrate(self, servos: ServoCalibration) -> None:
        """Use this calibration and tell the servos their limits and speed; they have to be limp."""
        check_owner(servos, self.unique_id)
        if servos.unit != "ticks":
            raise NotCalibrated(f"the calibration of {self.name} is not one of bus servos")
        if self._armed:
            raise NotArmed(f"{self.name} is armed, and should not be", "connect it anew, which disarms it")
        ordered = servos.ordered(self.joints)
        for servo, (low, high) in zip(self._ids, ordered.limits_us, strict=True):
            # The servo's own lock is on: this lasts until it is switched off, and wears nothing out.
            limits = struct.pack("<HH", max(0, math.ceil(low)), min(4095, math.floor(high)))
            self._linked.write(servo, Register.LOW_LIMIT, limits)
            torque = struct.pack("<H", round(self.settings.torque * 1000))
            self._linked.write(servo, Register.TORQUE_LIMIT, torque)
        self.calibration = ordered

    def arm(self) -> None:
        """See :class:`Robot`; the servos get torque with the first :meth:`act`."""
        self._calibrated()
        if self._stopped:
            raise Stopped(f"the emergency stop of {self.name} is latched", "connect it anew")
        self._armed = True

    def observe(self) -> RobotState:
        """See :class:`Robot`.

        Raises:
            ServoFault: If a servo reports a fault, or its supply or temperature is out of bounds.
        """
        return self._understood([self._reading(servo) for servo in self._ids], clamped=False)

    def act(self, targets: Vector) -> RobotState:
        """See :class:`Robot`. All servos start in the same moment; each is asked whether it has understood."""
        if not np.isfinite(targets).all():
            raise ValueError(f"{self.name} cannot go for {targets}")
        wanted = self._calibrated().pulses(targets)
        if self._stopped:
            raise Stopped(f"the emergency stop of {self.name} is latched", "connect it anew")
        if not self._armed:
            raise NotArmed(f"{self.name} is not armed")
        low, high = self._calibrated().limits_us.T
        goals = np.rint(np.clip(wanted, np.ceil(low), np.floor(high))).astype(int).tolist()
        if tuple(goals) != self._last and self.sensor is not None:
            self.sensor.moved(self._clock.now())
        orders = {
            servo: struct.pack("<HHH", goal, 0, self.settings.speed)
            for servo, goal in zip(self._ids, goals, strict=True)
        }
        self._linked.write_all(Register.GOAL, orders)
        if self._last is None:
            for servo in self._ids:
                self._linked.write(servo, Register.TORQUE_ENABLE, b"\1")
        self._last = tuple(goals)
        readings = []
        for servo, goal in zip(self._ids, goals, strict=True):
            reading = self._reading(servo)
            if (reading.goal, reading.torque) != (goal, True):  # a broadcast has no answer: it may be lost
                self._linked.write(servo, Register.GOAL, orders[servo])
                self._linked.write(servo, Register.TORQUE_ENABLE, b"\1")
                reading = self._reading(servo)
            readings.append(reading)
        return self._understood(readings, clamped=bool((np.abs(wanted - goals) > 1).any()))

    def positions(self) -> Vector:
        """(joints,) where the servos are, ticks, whoever turned them there."""
        return np.array([self._reading(servo).position for servo in self._ids], dtype=float)

    def stop(self) -> None:
        """See :class:`Robot`; latched until it is connected anew."""
        self._stopped, self._armed = True, False
        self._relax()

    def disconnect(self) -> None:
        """See :class:`Robot`."""
        line, self._armed = self._line, False
        if line is None:
            return
        try:
            with contextlib.suppress(UserError):
                self._relax()
        finally:
            self._line = None
            line.close()
            if self.imu is not None:
                self.imu.disconnect()

    @property
    def _linked(self) -> FeetechLine:
        return connected(self._line, self.name)

    def _calibrated(self) -> ServoCalibration:
        return configured(self.calibration, self.name)

    def _relax(self) -> None:
        """Torque off: once to all together, at once, and then to each until it has said yes."""
        self._last = None
        self._linked.write_all(Register.TORQUE_ENABLE, dict.fromkeys(self._ids, b"\0"))
        failed: UserError | None = None
        for servo in self._ids:
            try:
                self._linked.write(servo, Register.TORQUE_ENABLE, b"\0")
            except UserError as error:  # the others must become limp all the same
                failed = error
        if failed is not None:
            raise failed

    def _reading(self, servo: int) -> ServoReading:
        return read_servo(self._linked, servo, self.settings)

    def _understood(self, readings: list[ServoReading], *, clamped: bool) -> RobotState:
        at = self._clock.now()
        live = np.array([reading.torque for reading in readings])
        goals = np.where(live, [float(reading.goal) for reading in readings], math.nan)
        angles = self._calibrated().angles(goals)
        flags = Flags.ARMED if self._armed else Flags(0)
        flags |= Flags.PULSES if live.any() else Flags(0)
        flags |= Flags.CLAMPED if clamped else Flags(0)
        flags |= Flags.STOPPED if self._stopped else Flags(0)
        if any(reading.moving for reading in readings):
            flags |= Flags.SLEWING
            if self.sensor is not None:
                self.sensor.moved(at)
        tilt = up = None
        if self.sensor is not None and self.imu is not None:
            state = self.imu.ask(Request.READ)
            tilt, up = self.sensor.read(state, at)
        return RobotState(angles, angles, tilt, clamped, flags, at, up)
