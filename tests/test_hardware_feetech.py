"""Bus servos: the documented protocol at a real port. The servos are emulated from their data sheet only."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_board import UNIQUE, Peer, Table, upright

from testbed.hardware.calibration.records import JointCalibration, ServoCalibration, save_calibration, today
from testbed.hardware.emulation.feetech_bus import FeetechBus
from testbed.hardware.emulation.wire import Wire, WireFaults
from testbed.hardware.failures import (
    CalibrationForeign,
    LinkLost,
    NoAnswer,
    NotArmed,
    NotCalibrated,
    PortMissing,
    ServoFault,
    Stopped,
    WrongBoard,
)
from testbed.hardware.line.bus import Instruction, Register, packet, split
from testbed.hardware.line.protocol import Flags
from testbed.hardware.robots.board import Address
from testbed.hardware.robots.bus_servo import TICKS_PER_RAD, BusSettings
from testbed.hardware.robots.feetech import FeetechRobot
from testbed.hardware.robots.robot import Robot

TICK = 0.5 / TICKS_PER_RAD
IDS = {"left": 3, "right": 7}
ADAPTER = "5A7B123"


def calibration(unit: str = "ticks", unique_id: str = ADAPTER) -> ServoCalibration:
    joints = {
        name: JointCalibration(
            centre_us=2000.0 + number, us_per_rad=TICKS_PER_RAD * (-1) ** number, low_deg=-80, high_deg=80
        )
        for number, name in enumerate(IDS)
    }
    return ServoCalibration.model_validate(
        {"unit": unit, "unique_id": unique_id, "board_id": "student", "created": today(), "joints": joints}
    )


@dataclass
class Bench:
    bus: FeetechBus
    wire: Wire
    table: Table
    robot: FeetechRobot

    def ready(self) -> FeetechRobot:
        self.robot.connect()
        self.robot.configure()
        self.robot.arm()
        return self.robot

    def torques(self) -> list[bool]:
        return [servo.torque for servo in self.bus.servos.values()]


@pytest.fixture(params=[False, True], ids=["adapter", "echoing adapter"])
def bench(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Bench]:
    bus, wire = FeetechBus(IDS.values(), echo=request.param), Wire(tmp_path / "ttyF", seed=2)
    board, board_wire = Peer(), Wire(tmp_path / "ttyI")
    table = Table((bus, wire), (board, board_wire))
    save_calibration(calibration(), tmp_path)
    save_calibration(upright(board_id="peer"), tmp_path)
    robot = FeetechRobot(
        Address(name="student", unique_id=ADAPTER, port=wire.path),
        IDS,
        table,
        imu=Address(name="student", unique_id=UNIQUE, globs=(board_wire.path,)),
        calibrations=tmp_path,
    )
    yield Bench(bus, wire, table, robot)
    robot.disconnect()
    wire.close()
    board_wire.close()


@given(st.integers(0, 253), st.integers(0, 255), st.binary(max_size=60))
def test_packets_come_out_as_they_went_in(servo: int, code: int, parameters: bytes) -> None:
    pending = bytearray(b"\x01\xff" + packet(servo, code, parameters) * 2 + b"\xff\xff\x01")
    assert split(pending) == [(servo, code, parameters)] * 2
    assert pending == b"\xff\xff\x01"


def test_packets_are_those_of_the_data_sheet() -> None:
    assert packet(1, Instruction.PING).hex(" ") == "ff ff 01 02 01 fb"
    assert packet(1, Instruction.READ, bytes((0x38, 2))).hex(" ") == "ff ff 01 04 02 38 02 be"
    assert split(bytearray.fromhex("ff ff 01 02 01 fa")) == []


def test_what_is_commanded_is_gone_for_and_told_back(bench: Bench) -> None:
    robot: Robot = bench.ready()
    assert bench.torques() == [False, False]  # nothing moves before the first command
    wanted = np.array([0.4, -0.7])
    state = robot.act(wanted)
    assert bench.torques() == [True, True]
    assert state.applied == pytest.approx(wanted, abs=TICK)
    assert not state.clamped
    assert state.tilt == pytest.approx([0, 0], abs=1e-3)
    assert state.flags & Flags.SLEWING
    bench.table.sleep(0.3)
    assert bench.bus.servos[3].position == pytest.approx(2000 + 0.4 * TICKS_PER_RAD, abs=1)
    assert bench.bus.servos[7].position == pytest.approx(2001 + 0.7 * TICKS_PER_RAD, abs=1)
    assert not robot.observe().flags & Flags.SLEWING


def test_beyond_the_limits_it_is_clamped_and_reported(bench: Bench) -> None:
    robot = bench.ready()
    state = robot.act(np.array([9.0, -9.0]))
    assert state.clamped
    assert state.applied == pytest.approx(np.radians([80, -80]), abs=2 * TICK)
    assert bench.bus.servos[3].table[Register.HIGH_LIMIT] > 0  # the servo itself knows too
    with pytest.raises(ValueError, match="cannot go for"):
        robot.act(np.array([math.inf, 0.0]))


@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt])
def test_it_is_limp_after_an_exception_and_ctrl_c(bench: Bench, kind: type[BaseException]) -> None:
    def live() -> None:
        with bench.ready() as robot:
            robot.act(np.zeros(2))
            raise kind

    with pytest.raises(kind):
        live()
    bench.table.sleep(0.01)
    assert bench.torques() == [False, False]
    bench.robot.disconnect()
    with pytest.raises(LinkLost, match="not connected"):
        bench.robot.stop()


def test_refusals_have_their_names(bench: Bench) -> None:
    robot = bench.robot
    with pytest.raises(NotCalibrated):
        robot.act(np.zeros(2))
    robot.connect()
    with pytest.raises(NotCalibrated):
        robot.arm()
    with pytest.raises(CalibrationForeign):
        robot.calibrate(calibration(unique_id="other"))
    with pytest.raises(NotCalibrated, match="not one of bus servos"):
        robot.calibrate(calibration("us"))
    robot.configure()
    with pytest.raises(NotArmed):
        robot.act(np.zeros(2))
    robot.arm()
    robot.act(np.zeros(2))
    with pytest.raises(NotArmed):
        robot.configure()
    robot.stop()
    assert bench.torques() == [False, False]
    for attempt in (robot.arm, lambda: robot.act(np.zeros(2))):
        with pytest.raises(Stopped):
            attempt()
    assert robot.observe().flags & Flags.STOPPED
    assert np.isnan(robot.observe().applied).all()


@pytest.mark.parametrize(
    ("bits", "words"),
    [
        (1, "voltage"),
        (2, "angle sensor"),
        (4, "overheated"),
        (8, "current"),
        (32, "overload"),
        (36, "overheated, overload"),
    ],
)
def test_a_servos_own_faults_are_named(bench: Bench, bits: int, words: str) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.bus.servos[7].fault = bits
    with pytest.raises(ServoFault, match=f"servo 7 of student reports: {words}; let it cool"):
        robot.act(np.zeros(2))
    robot.disconnect()
    assert bench.torques() == [False, False]


def test_a_bad_supply_and_heat_are_named_before_the_servo_switches_off(bench: Bench) -> None:
    robot = bench.ready()
    bench.bus.servos[3].table[Register.VOLTAGE] = 45
    with pytest.raises(ServoFault, match=r"servo 3 of student has a supply of 4\.5 V"):
        robot.observe()
    bench.bus.servos[3].table[Register.VOLTAGE] = 74
    bench.bus.servos[3].table[Register.TEMPERATURE] = 66
    with pytest.raises(ServoFault, match="66 degrees Celsius hot"):
        robot.observe()


def test_a_servo_that_is_not_there_or_another_one_is_named(bench: Bench) -> None:
    gone = bench.bus.servos.pop(7)
    with pytest.raises((NoAnswer, LinkLost), match="servo 7 of student does not answer"):
        bench.robot.connect()
    bench.bus.servos[7] = gone
    gone.table[Register.MODEL] = 1
    with pytest.raises(WrongBoard, match=r"model 769, not 777 \(STS3215\)"):
        bench.robot.connect()
    bench.wire.unplug()
    with pytest.raises(PortMissing):
        bench.robot.connect()


def test_a_servo_that_leaves_in_the_middle_is_a_lost_link_and_the_others_go_limp(bench: Bench) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    del bench.bus.servos[3]
    with pytest.raises(LinkLost, match="servo 3 of student does not answer any more"):
        robot.act(np.zeros(2))
    robot.disconnect()
    assert bench.torques() == [False]


@pytest.mark.parametrize("rate", [0.001, 0.01])
def test_on_a_bad_line_commands_arrive_or_are_lost_by_name(bench: Bench, rate: float) -> None:
    """The bus has a checksum of one byte and no numbers: what is read is held against what was commanded."""
    robot = bench.ready()
    bench.wire.faults = WireFaults(drop=rate / 3, flip=rate / 3, double=rate / 3)
    lost = 0
    for step in range(60):
        wanted = np.array([0.5 * math.sin(step / 10), 0.3 * math.cos(step / 7)])
        try:
            state = robot.act(wanted)
        except (LinkLost, ServoFault):
            lost += 1
            continue
        assert state.applied == pytest.approx(wanted, abs=TICK)
        bench.table.sleep(1 / 30)
    assert lost <= (0 if rate < 0.01 else 6)


def test_it_is_found_by_its_adapters_serial_number_or_missing(tmp_path: Path) -> None:
    robot = FeetechRobot(
        Address(name="student", unique_id="none"), IDS, Table(), settings=BusSettings(torque=0.3)
    )
    with pytest.raises(PortMissing, match="the adapter none of student is not there"):
        robot.connect()
