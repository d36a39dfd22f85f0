"""Servos are found by their procedures, and implausible ones refused."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from calibrating_bench import Chip, calibrating_bench
from hypothesis import given
from hypothesis import strategies as st
from one_board import JOINTS, UNIQUE, Table

from testbed.errors import UserError
from testbed.hardware.calibration.records import (
    load_servos,
    save_calibration,
)
from testbed.hardware.calibration.servos import calibrate_bus, calibrate_servos, fit_joint
from testbed.hardware.emulation.feetech_bus import FeetechBus
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.wire import Wire
from testbed.hardware.failures import Stopped
from testbed.hardware.line.bus import Register
from testbed.hardware.line.protocol import Flags, Request
from testbed.hardware.prompt import Question, nothing
from testbed.hardware.robots.board import Address
from testbed.hardware.robots.feetech import FeetechRobot
from testbed.hardware.robots.servo_board import ServoBoard


@pytest.fixture
def chip(tmp_path: Path) -> Iterator[Chip]:
    with calibrating_bench(tmp_path) as chip:
        yield chip


WIDE = (-90.0, 90.0)


@given(
    st.floats(1150, 1850),
    st.floats(370, 1100),
    st.booleans(),
    st.lists(st.floats(-0.017, 0.017), min_size=5, max_size=5),
)
def test_a_servo_is_found_from_angles_read_to_a_degree(
    centre: float, gain: float, reverse: bool, errors: list[float]
) -> None:
    slope = -gain if reverse else gain
    marks = [
        (pulse, (pulse - centre) / slope + error)
        for pulse, error in zip((1500, 1250, 1000, 1750, 2000), errors, strict=True)
    ]
    found = fit_joint("left", marks, WIDE)
    assert abs(found.centre_us - centre) <= gain * 0.017 + 17
    assert found.us_per_rad / slope == pytest.approx(1, abs=0.1)
    assert found.residual_deg <= 1.5
    reached = [
        found.centre_us + found.us_per_rad * math.radians(end) for end in (found.low_deg, found.high_deg)
    ]
    assert 499.9 <= min(reached) < max(reached) <= 2500.1
    assert -90 <= found.low_deg < found.high_deg <= 90


@pytest.mark.parametrize(
    ("marks", "words"),
    [
        ([(1500, 0.0), (1000, -0.8)], "at least three"),
        ([(1500, 0.0), (1000, math.nan), (2000, 0.8)], "at least three"),
        ([(1500, 0.0), (1000, -0.1), (2000, 0.1)], "within 11 degrees"),
        ([(1500, 0.0), (1500, -0.8), (1500, 0.8)], "within"),
        ([(1500, 0.0), (1000, -0.8), (2000, -0.8)], "lie on no line"),
        ([(1500, 0.0), (1000, -0.8), (1250, -0.4), (1750, 0.4), (2000, -0.8)], "worst at 2000: "),
        ([(1500, 0.0), (1000, -1.6), (2000, 1.6)], "no servo's gain"),
        ([(1500, 1.2), (1000, 0.4), (2000, 2.0)], "would lie flat at 750"),
    ],
)
def test_implausible_servos_are_refused(marks: list[tuple[float, float]], words: str) -> None:
    with pytest.raises(UserError, match=words):
        fit_joint("left", marks, WIDE)


LINES = {"left": (1512.0, 590.0), "right": (1473.0, -610.0)}


class Person:
    """Reads angles off a protractor, to a degree, or brings joints to angles; slow to answer."""

    def __init__(self, chip: Microcontroller, table: Table, *, upside_down: float = 1.0) -> None:
        self.chip, self.table, self.questions = chip, table, list[Question]()
        self._sign = upside_down
        self._widths = {0: 0.0, 1: 0.0}
        self.widths: list[float] = []

    def __call__(self, question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        self.questions.append(question)
        for _ in range(4 if len(self.questions) % 7 else 40):
            self.table.sleep(0.1)
            meanwhile()
        for pulse in self.chip.pulses():
            self._widths[pulse.channel] = pulse.width_us
            self.widths.append(pulse.width_us)
        joint = str(question.details["joint"])
        centre, slope = LINES[joint]
        at = math.degrees((self._widths[list(LINES).index(joint)] - centre) / slope) * self._sign
        if question.kind == "servo_angle":
            return "what?" if len(self.questions) == 2 else f"{round(at)}"
        way = math.radians(float(question.details["angle_deg"]) - at) * slope
        return str(round(way / float(question.details["step_us"])))


@pytest.mark.parametrize("nudging", [False, True])
def test_servos_are_calibrated_with_a_person_and_limp_afterwards(
    chip: Chip, tmp_path: Path, nudging: bool
) -> None:
    microcontroller, board, table = chip
    person = Person(microcontroller, table)
    found = calibrate_servos(board, dict.fromkeys(LINES, WIDE), person, nudging=nudging)
    for joint, (centre, slope) in LINES.items():
        line = found.joints[joint]
        assert abs(line.centre_us - centre) < 12
        assert line.us_per_rad == pytest.approx(slope, rel=0.03)
        assert line.residual_deg < 1
        assert (line.low_deg, line.high_deg) == WIDE
    assert (found.unique_id, found.board_id) == (UNIQUE, "hob")
    assert min(person.widths) >= 980
    assert max(person.widths) <= 2020  # no servo was driven to its end
    assert not board.raw(Request.READ).flags & (Flags.ARMED | Flags.LATCHED_LIMP | Flags.LATCHED_HELD)
    save_calibration(found, tmp_path)
    robot = ServoBoard(board.address, JOINTS, table)
    board.disconnect()
    with robot:
        robot.connect()
        robot.calibrate(load_servos(tmp_path, UNIQUE))
        robot.arm()
        robot.act(np.array([0.5, -0.5]))
        table.sleep(0.1)
        last = {pulse.channel: pulse.width_us for pulse in microcontroller.pulses()}
    turned = [(last[channel] - centre) / slope for channel, (centre, slope) in enumerate(LINES.values())]
    assert turned == pytest.approx([0.5, -0.5], abs=0.03)


def test_a_person_who_misreads_and_a_stop_in_the_middle_leave_it_limp(
    chip: Chip,
) -> None:
    microcontroller, board, table = chip
    answers = iter(["0", "40", "-40", "40", "40"])
    with pytest.raises(UserError, match="joint 'left': the marks lie on no line"):
        calibrate_servos(board, dict.fromkeys(LINES, WIDE), lambda question, meanwhile=nothing: next(answers))
    assert not board.raw(Request.READ).flags & Flags.ARMED

    def stopping(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        microcontroller.press_stop()
        table.sleep(0.05)
        return "0"

    with pytest.raises(Stopped):
        calibrate_servos(board, dict.fromkeys(LINES, WIDE), stopping)


def test_bus_servos_are_calibrated_by_hand(tmp_path: Path) -> None:
    bus, wire = FeetechBus([1, 2]), Wire(tmp_path / "port")
    table = Table((bus, wire))

    def hands(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        servo = bus.servos[1 + JOINTS.index(str(question.details["joint"]))]
        assert not servo.torque
        turned = math.radians(float(question.details["angle_deg"]) + 0.4) * 4096 / (2 * math.pi)
        servo.move(2100 - turned)
        table.sleep(0.01)
        return ""

    with FeetechRobot(Address(name="student", port=wire.path), {"left": 1, "right": 2}, table) as robot:
        robot.connect()
        found = calibrate_bus(robot, dict.fromkeys(JOINTS, WIDE), hands)
        robot.calibrate(found)
        robot.arm()
        assert robot.act(np.array([0.3, 0.3])).applied == pytest.approx([0.3, 0.3], abs=0.001)
        goal = int.from_bytes(bus.servos[1].table[Register.GOAL : Register.GOAL + 2], "little")
        assert goal == pytest.approx(2100 - (0.3 + math.radians(0.4)) * 652, abs=1)
    assert found.unit == "ticks"
    assert found.joints["left"].us_per_rad == pytest.approx(-652, abs=1)
    wire.close()
