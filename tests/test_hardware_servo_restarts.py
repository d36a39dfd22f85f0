"""Boards that restart, are pulled out, are others than they should be, or were calibrated as others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from one_board import JOINTS, UNIQUE, address, servos, upright
from servo_bench import Bench, servo_bench

from testbed.hardware.calibration.records import ServoCalibration
from testbed.hardware.failures import (
    BoardRestarted,
    CalibrationForeign,
    LinkLost,
    NoAnswer,
    PortMissing,
    WentLimp,
    WrongBoard,
    WrongFirmware,
)
from testbed.hardware.line.protocol import Flags
from testbed.hardware.robots.board import Address, Board
from testbed.hardware.robots.servo_board import ServoBoard


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with servo_bench(tmp_path) as bench:
        yield bench


def test_a_hang_is_a_restart_that_is_never_armed_again_by_itself(bench: Bench) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.chip.hang()
    with pytest.raises(BoardRestarted, match="the board of student has restarted: a watchdog reset"):
        bench.live(0.7)
    for attempt in (lambda: robot.act(np.zeros(2)), robot.arm, robot.observe, robot.reconnect):
        with pytest.raises(BoardRestarted):
            attempt()
    assert bench.quiet()
    bench.ready().act(np.zeros(2))  # on purpose it is


def test_a_brown_out_is_a_restart_with_its_cause(bench: Bench) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.chip.brown_out(0.005)
    with pytest.raises(BoardRestarted, match="a brown-out; check the supply"):
        bench.live(0.2)
    assert bench.quiet()


def test_a_power_cut_that_lasts_is_a_lost_link_and_then_a_restart(bench: Bench) -> None:
    robot = bench.ready()
    bench.chip.power_off()
    with pytest.raises(LinkLost, match="student does not answer any more"):
        robot.act(np.zeros(2))
    bench.chip.power_on()
    bench.table.sleep(0.1)
    with pytest.raises(BoardRestarted, match="power-on"):
        robot.act(np.zeros(2))


def test_a_board_that_comes_back_while_it_is_looked_for_is_a_restart(bench: Bench) -> None:
    """A real Uno is silent in its boot loader for up to two seconds."""
    robot = bench.ready()
    bench.chip.power_off()
    bench.table.at(bench.table.now() + 1.5, bench.chip.power_on)
    with pytest.raises(BoardRestarted, match="power-on"):
        robot.act(np.zeros(2))


def test_a_board_that_boots_slowly_is_waited_for(bench: Bench) -> None:
    bench.chip.power_off()
    bench.table.at(2.0, bench.chip.power_on)
    assert bench.robot.connect().unique_id == UNIQUE
    for late in (0.038, 0.0385, 0.039):  # asked again in its first milliseconds, before it knows its sensor
        bench.robot.disconnect()
        bench.chip.power_off()
        bench.table.at(bench.table.now() + late, bench.chip.power_on)
        assert bench.robot.connect().imu == 0x68


def test_nothing_at_the_port_is_no_answer_after_three_seconds(bench: Bench) -> None:
    bench.chip.power_off()
    with pytest.raises(NoAnswer, match=r"student does not answer on .*ttyA for 3 s; check power"):
        bench.robot.connect()
    assert 3 <= bench.table.now() < 3.2


def test_a_cable_pulled_and_plugged_in_elsewhere_is_found_again_by_the_boards_id(bench: Bench) -> None:
    where = Address(name="student", unique_id=UNIQUE, globs=(str(bench.folder / "tty*"),))
    robot = ServoBoard(where, JOINTS, bench.table, calibrations=bench.folder / "calibrations")
    with robot:
        robot.connect()
        robot.configure()
        robot.arm()
        robot.act(np.zeros(2))
        bench.wire.unplug()
        with pytest.raises(LinkLost, match="is gone"):
            robot.act(np.zeros(2))
        with pytest.raises(PortMissing, match=f"the board {UNIQUE} of student is not there"):
            robot.reconnect()
        bench.wire.replug(bench.folder / "ttyB")
        bench.table.sleep(0.4)
        robot.reconnect()
        assert robot.board.path.endswith("ttyB")
        state = robot.act(np.zeros(2))  # its power stayed on: it was armed all the time and held
        assert state.flags & Flags.LATCHED_HELD
        bench.wire.unplug()
        bench.wire.replug()
        bench.table.sleep(2.1)
        robot.reconnect()
        with pytest.raises(WentLimp):
            robot.act(np.zeros(2))
        bench.wire.unplug()
        bench.chip.power_cycle()  # as USB does that feeds the board
        bench.wire.replug()
        with pytest.raises(BoardRestarted):
            robot.reconnect()
        with pytest.raises(BoardRestarted):
            robot.act(np.zeros(2))
    assert bench.quiet()


def test_another_board_at_the_port_is_named(bench: Bench) -> None:
    robot = ServoBoard(address(bench.wire, "00" * 8), JOINTS, bench.table)
    with pytest.raises(
        WrongBoard, match=f"{UNIQUE} .'hob'. answers where student should be, which is {'00' * 8}"
    ):
        robot.connect()
    with pytest.raises(WrongBoard, match="drives 2 servos, the body has 3"):
        Board(address(bench.wire), 3, bench.table).connect()


def test_calibrations_of_another_board_and_of_another_name_are_refused(bench: Bench) -> None:
    bench.robot.connect()
    with pytest.raises(CalibrationForeign):
        bench.robot.calibrate(servos("00" * 8))
    with pytest.raises(CalibrationForeign):
        bench.robot.calibrate(servos(), upright("00" * 8))
    bench.robot.joints = ("a", "b")
    with pytest.raises(CalibrationForeign, match="for the joints left, right, the body has a, b"):
        bench.robot.calibrate(servos())
    bench.robot.joints = JOINTS
    bench.robot.board.rename("another")
    assert bench.robot.board.identity.board_id == "another"
    with pytest.raises(CalibrationForeign, match="was calibrated as 'hob' and is named 'another' now"):
        bench.robot.configure()
    with pytest.raises(ValueError, match="1 to 16"):
        bench.robot.board.rename("two words")


def test_a_calibration_beyond_what_the_firmware_sends_is_refused(bench: Bench) -> None:
    wide = servos()
    wide = replace_joint(wide, "left", us_per_rad=1100.0)
    bench.robot.connect()
    with pytest.raises(WrongFirmware, match="does not accept the values of CONFIGURE"):
        bench.robot.calibrate(wide)


def replace_joint(calibration: ServoCalibration, joint: str, **changes: float) -> ServoCalibration:
    joints = dict(calibration.joints)
    joints[joint] = joints[joint].model_copy(update=changes)
    return calibration.model_copy(update={"joints": joints})
