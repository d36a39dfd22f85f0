"""Calibrations: found by their procedures, kept in files, believed about their own device only."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_board import JOINTS, UNIQUE, Table, address, servos, upright
from simavr_needed import simavr_or_skip

from testbed.errors import UserError
from testbed.frames import rotation_about, tilt_of
from testbed.hardware.board import Address, Board
from testbed.hardware.calibration import (
    calibration_file,
    load_servos,
    load_tilt,
    save_calibration,
    tilt_from,
)
from testbed.hardware.emulation.feetech_bus import FeetechBus
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.wire import Wire
from testbed.hardware.failures import CalibrationForeign, ImuMissing, ImuStuck, NotCalibrated, Stopped
from testbed.hardware.feetech import FeetechRobot
from testbed.hardware.feetech_line import Register
from testbed.hardware.prompt import Question, nothing
from testbed.hardware.protocol import Flags, Request
from testbed.hardware.servo_board import ServoBoard
from testbed.hardware.servo_calibration import calibrate_bus, calibrate_servos, fit_joint
from testbed.hardware.tilt_calibration import ORIENTATIONS, calibrate_tilt, fit_tilt

WIDE = (-90.0, 90.0)
angle = st.floats(-1, 1)
small = st.floats(-0.05, 0.05)


# --- files


def test_a_calibration_is_read_as_it_was_kept_and_kept_beside_others(tmp_path: Path) -> None:
    path = save_calibration(servos(), tmp_path / "calibrations")
    save_calibration(upright(), tmp_path / "calibrations")
    save_calibration(servos("12e4567890123456"), tmp_path / "calibrations")  # no number
    assert path == calibration_file(tmp_path / "calibrations", UNIQUE, "servos")
    assert load_servos(path.parent, UNIQUE) == servos()
    assert load_servos(path.parent, UNIQUE, "hob") == servos()
    assert load_tilt(path.parent, UNIQUE) == upright()
    assert load_servos(path.parent, "12e4567890123456").unique_id == "12e4567890123456"
    assert len(list(path.parent.iterdir())) == 3


def test_one_that_is_missing_foreign_or_of_another_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        NotCalibrated, match=f"there is no servos calibration of board {UNIQUE}; run .*calibrate servos"
    ):
        load_servos(tmp_path, UNIQUE)
    path = save_calibration(servos(), tmp_path)
    with pytest.raises(CalibrationForeign, match="was calibrated as 'hob' and is named 'arm' now"):
        load_servos(tmp_path, UNIQUE, "arm")
    other = calibration_file(tmp_path, "ff" * 8, "servos")
    other.write_bytes(path.read_bytes())  # copied by hand
    with pytest.raises(CalibrationForeign, match=f"is of board {UNIQUE}, this is ffff"):
        load_servos(tmp_path, "ff" * 8)
    path.write_text(path.read_text().replace("version: 1", "version: 2"))
    with pytest.raises(CalibrationForeign, match="is of version 2, not 1"):
        load_servos(tmp_path, UNIQUE)


def test_a_damaged_file_is_refused_wherever_it_is_damaged(tmp_path: Path) -> None:
    path = save_calibration(upright(), tmp_path)
    whole = path.read_bytes()
    for end in range(0, len(whole) - 1, 5):  # without its last line end it still is whole
        path.write_bytes(whole[:end])
        with pytest.raises((NotCalibrated, CalibrationForeign)):
            load_tilt(tmp_path, UNIQUE)
    for at in range(0, len(whole), 3):
        spoilt = bytearray(whole)
        spoilt[at] ^= 1
        path.write_bytes(spoilt)
        with contextlib.suppress(NotCalibrated, CalibrationForeign):
            assert load_tilt(tmp_path, UNIQUE) == upright()  # a blank more or less says the same
    path.write_bytes(whole.replace(b"scale:\n- 1.0", b"scale:\n- 1.5"))
    with pytest.raises(NotCalibrated, match="was changed; run 'testbed hardware calibrate tilt'"):
        load_tilt(tmp_path, UNIQUE)


def test_one_that_cannot_be_kept_leaves_the_old_one(tmp_path: Path) -> None:
    save_calibration(servos(), tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError):
        save_calibration(servos(), tmp_path / "file")
    assert load_servos(tmp_path, UNIQUE) == servos()


# --- servos


@given(st.lists(angle, min_size=2, max_size=2))
def test_angles_become_pulses_and_angles_again(angles: list[float]) -> None:
    wanted = np.array(angles)
    assert servos().angles(servos().pulses(wanted)) == pytest.approx(wanted, abs=1e-12)
    low, high = servos().limits_us.T
    assert (low < high).all()
    assert ((low <= servos().pulses(wanted)) & (servos().pulses(wanted) <= high)).all()


def test_the_order_of_joints_is_the_bodys() -> None:
    turned = servos().ordered(JOINTS[::-1])
    assert list(turned.joints) == list(JOINTS[::-1])
    assert turned.pulses(np.zeros(2)).tolist() == servos().pulses(np.zeros(2)).tolist()[::-1]


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


@pytest.fixture
def chip(tmp_path: Path) -> Iterator[tuple[Microcontroller, Board, Table]]:
    simavr_or_skip()
    chip = Microcontroller(name="hob", unique_id=UNIQUE, seed=2)
    wire = Wire(tmp_path / "port")
    table = Table((chip, wire))
    board = Board(address(wire), 2, table)
    board.connect()
    yield chip, board, table
    board.disconnect()
    wire.close()
    chip.close()


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
    chip: tuple[Microcontroller, Board, Table], tmp_path: Path, nudging: bool
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
    chip: tuple[Microcontroller, Board, Table],
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


# --- tilt


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_tilt_from_an_acceleration_is_the_tilt_of_the_pose(parts: list[float]) -> None:
    quaternion = np.array(parts) / np.linalg.norm(parts)
    x, y, z, w = quaternion
    up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    assert tilt_from(up) == pytest.approx(tilt_of(quaternion), abs=1e-9)


def test_nose_down_and_left_side_down_have_the_signs_that_the_world_uses() -> None:
    assert tilt_from(np.array(ORIENTATIONS["nose_down"]))[1] == pytest.approx(math.pi / 2)
    assert tilt_from(np.array(ORIENTATIONS["left_side"]))[0] == pytest.approx(-math.pi / 2)
    half = math.sqrt(0.5)  # turned about y: the nose goes down for positive angles
    assert tilt_of(np.array([0, half, 0, half]))[1] == pytest.approx(math.pi / 2)
    assert tilt_of(np.array([-half, 0, 0, half]))[0] == pytest.approx(-math.pi / 2)


def sensed(up: np.ndarray, mount: np.ndarray, bias: np.ndarray, gain: np.ndarray) -> list[float]:
    """Counts of a sensor that is turned by ``mount`` against the body."""
    return (16384 * (gain * (mount @ up) + bias)).tolist()


@settings(deadline=None)
@given(
    st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3),
    st.lists(small, min_size=3, max_size=3),
    st.lists(small, min_size=3, max_size=3),
    st.sampled_from([4, 5, 6]),
)
def test_a_sensor_is_found_however_it_is_mounted(
    turning: list[float], bias: list[float], gains: list[float], count: int
) -> None:
    mount, gain = rotation_about(turning)[:3, :3], 1 + np.array(gains)
    poses = dict(list(ORIENTATIONS.items())[:count])
    fit = fit_tilt({pose: sensed(np.array(up), mount, np.array(bias), gain) for pose, up in poses.items()})
    assert fit.residual_deg < 0.02
    assert fit.rotation == pytest.approx(mount.T, abs=1e-3)
    assert fit.bias == pytest.approx(bias, abs=1e-3)
    assert fit.scale == pytest.approx(1 / gain, abs=2e-3)


def test_poses_that_are_a_degree_off_cost_less_than_a_degree_and_more_poses_less() -> None:
    rng = np.random.default_rng(3)
    errors: dict[int, list[float]] = {4: [], 6: []}
    for _ in range(60):
        mount = rotation_about(rng.normal(0, 0.05, 3).tolist())[:3, :3]
        gain, bias = rng.uniform(0.98, 1.02, 3), rng.uniform(-0.05, 0.05, 3)
        counts = {}
        for pose, up in ORIENTATIONS.items():
            askew = rotation_about(np.radians(rng.normal(0, 1 / math.sqrt(2), 3)).tolist())[:3, :3]
            counts[pose] = sensed(askew @ up, mount, bias, gain)
        for count, found in errors.items():
            fit = fit_tilt(dict(list(counts.items())[:count]))
            felt = np.array(sensed(np.array([0, 0, 1.0]), mount, bias, gain)) / 16384
            level = fit.rotation @ ((felt - fit.bias) * fit.scale)
            found.append(math.degrees(np.abs(tilt_from(level)).max()))
    assert np.median(errors[6]) < np.median(errors[4]) + 0.05
    assert np.percentile(errors[6], 95) < 1.5


def test_implausible_sensors_and_wrong_poses_are_refused() -> None:
    one = np.ones(3)
    counts = {pose: sensed(np.array(up), np.eye(3), np.zeros(3), one) for pose, up in ORIENTATIONS.items()}
    with pytest.raises(UserError, match="3 poses say too little; lay it down in at least 4"):
        fit_tilt(dict(list(counts.items())[:3]))
    with pytest.raises(UserError, match=r"contradict each other .* lay the robot down again"):
        fit_tilt({**counts, "left_side": counts["right_side"]})
    with pytest.raises(UserError, match=r"a scale of -1\.00"):  # a mirrored sensor is none
        fit_tilt({pose: [-x, y, z] for pose, (x, y, z) in counts.items()})
    with pytest.raises(UserError, match=r"cannot be: .* a scale of 0\.50"):  # set to another range
        fit_tilt({pose: [2 * x, 2 * y, 2 * z] for pose, (x, y, z) in counts.items()})
    with pytest.raises(UserError, match=r"a bias of 0\.40 g"):
        fit_tilt({pose: [x + 0.4 * 16384, y, z] for pose, (x, y, z) in counts.items()})


def test_a_tilt_sensor_is_calibrated_with_a_person(
    chip: tuple[Microcontroller, Board, Table], tmp_path: Path
) -> None:
    microcontroller, board, table = chip
    mount = rotation_about((0.05, -0.08, 1.6))[:3, :3]  # soldered on a quarter turn round
    bias, gain = np.array([0.03, -0.02, 0.04]), np.array([1.01, 0.99, 1.02])
    asked: list[str] = []

    def feel(up: np.ndarray) -> None:
        microcontroller.set_acceleration(*(gain * (mount @ up) + bias))

    def hands(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        pose = str(question.details["orientation"])
        asked.append(pose)
        if pose == "nose_up":
            return "skip"
        feel(np.array(ORIENTATIONS[pose]))
        if asked == ["level"]:  # still rocking the first time
            table.at(table.now() + 0.1, lambda: feel(np.array([0, 0.6, 0.8])))
        else:
            table.sleep(0.2)
        return ""

    found = calibrate_tilt(board, table, hands)
    assert asked == ["level", "level", "nose_down", "left_side", "upside_down", "nose_up", "right_side"]
    assert found.residual_deg < 0.3
    assert np.array(found.rotation) == pytest.approx(mount.T, abs=0.01)
    save_calibration(found, tmp_path)
    read = load_tilt(tmp_path, UNIQUE, "hob")
    feel(np.array([math.sin(-0.3), 0, math.cos(-0.3)]))
    table.sleep(0.2)
    state = board.ask(Request.READ)
    assert tilt_from(read.acceleration(state.acceleration)) == pytest.approx([0, 0.3], abs=0.01)


def test_a_sensor_that_fails_while_it_is_calibrated_is_named(
    chip: tuple[Microcontroller, Board, Table],
) -> None:
    microcontroller, board, table = chip
    for state, kind in (("unplugged", ImuMissing), ("stuck", ImuStuck)):
        microcontroller.set_imu(state)  # type: ignore[arg-type]
        table.sleep(0.5)
        with pytest.raises(kind):
            calibrate_tilt(board, table, lambda question, meanwhile=nothing: "")
        microcontroller.set_imu("fine")
        table.sleep(0.5)
