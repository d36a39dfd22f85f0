"""Looking over a robot of build B: its bus, each of its servos, their calibration, and the board beside them.

Nothing is written to a servo, so nothing moves and nobody who holds still lets go.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from testbed.hardware.calibration.records import load_servos
from testbed.hardware.clock import Clock
from testbed.hardware.doctor.boards import MOST_RETRIES, READS, BoardDoctor, servos_in_words
from testbed.hardware.doctor.checks import Check, checked, failed, passed
from testbed.hardware.failures import HardwareFailure, LinkLost, NotCalibrated
from testbed.hardware.line.bus import BUS_BAUD, FeetechLine
from testbed.hardware.line.ports import open_port
from testbed.hardware.robots.board import Address
from testbed.hardware.robots.bus_servo import BusSettings, check_model, read_servo
from testbed.hardware.robots.feetech import adapter_path, calibrated_as


class BusDoctor:
    """Looks one robot of bus servos over.

    Args:
        address: The adapter.
        servos: By joint, the servo's number on the bus.
        clock: The bench's.
        calibrations: The folder of calibrations.
        imu: The board with the tilt sensor, if there is one.
        reads: How many exchanges the lines are judged by.
    """

    def __init__(
        self,
        address: Address,
        servos: Mapping[str, int],
        clock: Clock,
        calibrations: Path,
        *,
        imu: Address | None,
        reads: int = READS,
    ) -> None:
        self._address, self._servos, self._clock, self._folder = address, servos, clock, calibrations
        self._imu, self._reads = imu, reads
        self._name = address.name

    def checks(self) -> Iterator[Check]:
        """One after the other."""
        yield from self._of_the_bus()
        yield checked(self._name, "servo calibration", self._calibration)
        if self._imu is not None:
            board = BoardDoctor(
                self._imu, self._clock, self._folder, imu=True, servos=False, reads=self._reads
            )
            yield from board.checks()

    def _of_the_bus(self) -> Iterator[Check]:
        try:
            port = open_port(adapter_path(self._address), baud=BUS_BAUD)
        except HardwareFailure as failure:
            yield failed(self._name, "bus adapter", failure)
            return
        line = FeetechLine(port, self._clock, name=self._name)
        try:
            yield passed(self._name, "bus adapter", str(port.port))
            for joint, servo in self._servos.items():
                yield checked(self._name, f"servo {servo}", functools.partial(_servo, line, joint, servo))
            if line.statistics.received:
                yield checked(self._name, "bus", lambda: self._line(line))
        finally:
            line.close()

    def _line(self, line: FeetechLine) -> str:
        before, servos, settings = line.statistics.retries, list(self._servos.values()), BusSettings()
        for number in range(self._reads):
            read_servo(line, servos[number % len(servos)], settings)
        retries = line.statistics.retries - before
        times = np.array(line.statistics.times)[-self._reads :]
        found = f"{self._reads} reads, {retries} repeated; {1000 * np.median(times):.1f} ms"
        if retries > MOST_RETRIES * self._reads:
            mend = "use shorter cables, away from the supply's; give the servos a supply that does not sag"
            raise LinkLost(f"a bad bus: {found}", mend)
        return found

    def _calibration(self) -> str:
        calibration = load_servos(self._folder, calibrated_as(self._address, self._servos.values()))
        if calibration.unit != "ticks":
            raise NotCalibrated(f"the calibration of {self._name} is not one of bus servos")
        return servos_in_words(calibration.ordered(tuple(self._servos)))


def _servo(line: FeetechLine, joint: str, servo: int) -> str:
    """What one servo says about itself.

    Raises:
        HardwareFailure: If it does not answer, is of another model, or is not well.
    """
    check_model(line, servo)
    now = read_servo(line, servo, BusSettings())
    pulls = "pulls!" if now.torque else "limp"
    return f"{joint}: {pulls}, at {now.position} ticks, {now.volts:.1f} V, {now.celsius} degrees Celsius"
