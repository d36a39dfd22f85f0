"""One robot of build A at a real port: the shipped firmware on an emulated microcontroller."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from one_board import JOINTS, UNIQUE, Table, address, servos, upright
from simavr_needed import simavr_or_skip

from testbed.hardware.calibration.records import save_calibration
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.wire import Wire
from testbed.hardware.robots.servo_board import ServoBoard

STEP = 1 / 30

HALF_US = 0.5 / 620  # rad


@dataclass
class Bench:
    """One board with all that belongs to it."""

    chip: Microcontroller
    wire: Wire
    table: Table
    robot: ServoBoard
    folder: Path

    def ready(self) -> ServoBoard:
        self.robot.connect()
        self.robot.configure()
        self.robot.arm()
        return self.robot

    def live(self, seconds: float, *, moving: bool = False) -> None:
        """Command it at every control step, to move or to stay."""
        for step in range(round(seconds / STEP)):
            self.table.sleep(STEP)
            self.robot.act(np.array([0.3 * (step % 2 * moving), 0.0]))

    def widths(self, channel: int = 0) -> list[float]:
        return [pulse.width_us for pulse in self.chip.pulses() if pulse.channel == channel]

    def quiet(self, seconds: float = 0.1) -> bool:
        """Whether no pulse begins within so many seconds from a frame on."""
        self.table.sleep(0.021)
        self.chip.pulses()
        self.table.sleep(seconds)
        return not self.chip.pulses()


@contextlib.contextmanager
def servo_bench(tmp_path: Path) -> Iterator[Bench]:
    simavr_or_skip()
    chip = Microcontroller(name="hob", unique_id=UNIQUE, seed=1)
    wire = Wire(tmp_path / "ttyA", seed=4)
    table = Table((chip, wire))
    for calibration in (servos(), upright()):
        save_calibration(calibration, tmp_path / "calibrations")
    robot = ServoBoard(address(wire, UNIQUE), JOINTS, table, calibrations=tmp_path / "calibrations")
    yield Bench(chip, wire, table, robot, tmp_path)
    robot.disconnect()
    wire.close()
    chip.close()
