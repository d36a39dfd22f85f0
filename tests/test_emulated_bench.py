"""The emulated bench: one virtual time for boards, bodies and cameras, and what came out of the shop."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from simavr_needed import simavr_or_skip

from testbed.bodies.morphology import load_robot
from testbed.errors import UserError
from testbed.frames import tilt_of
from testbed.hardware.bench_file import RIG
from testbed.hardware.calibration.records import tilt_from
from testbed.hardware.emulation.mounting import Mounting, felt
from testbed.hardware.emulation.servos import SILENCE, Servo, Servos
from testbed.physics import Simulation
from testbed.scenario import Scenario, drawn, load_scenario, parse_scenario
from testbed.world.placement import STUDENT

simavr_or_skip()  # type: ignore[no-untyped-call]

from testbed.hardware.emulation.bench import EmulatedBench  # noqa: E402
from testbed.hardware.emulation.hands import Hands  # noqa: E402
from testbed.hardware.prompt import Question  # noqa: E402
from testbed.hardware.robots.board import Address, Board  # noqa: E402

LIMITS = np.array([[600.0, 2400.0], [600.0, 2400.0]])


@pytest.fixture(scope="module")
def here() -> Scenario:
    return drawn(load_scenario("bench"), 0)


@pytest.fixture
def bench(here: Scenario, tmp_path: Path) -> Iterator[EmulatedBench]:
    with EmulatedBench(here, seed=1, ports=tmp_path) as bench:
        yield bench


def board_of(bench: EmulatedBench, name: str = STUDENT) -> Board:
    """A robot's board, armed."""
    there = bench.boards[name]
    address = Address(name=name, unique_id=there.unique_id, port=there.wire.path)
    board = Board(address, len(there.servos.servos), bench)
    board.connect()
    board.limit(LIMITS[: len(there.servos.servos)], 60.0)
    board.arm()
    return board


def feed(bench: EmulatedBench, board: Board, widths: list[float], seconds: float) -> None:
    until = bench.now() + seconds
    while bench.now() < until:
        board.drive(np.array(widths))
        bench.sleep(0.05)


# What came out of the shop.


@given(st.integers(0, 2**32 - 1))
def test_any_servo_reaches_ninety_degrees_with_pulses_that_the_firmware_sends(seed: int) -> None:
    servo = Servo.drawn(np.random.default_rng(seed))
    for angle in (-math.pi / 2, math.pi / 2):
        assert 500 < servo.width(angle) < 2500
        assert servo.angle(servo.width(angle)) == pytest.approx(angle)


def test_servos_let_go_when_there_are_no_pulses() -> None:
    servos = Servos([Servo(), Servo(us_per_rad=-500.0)])
    assert np.isnan(servos.targets(0.0)).all()
    servos.hear(1.0, 1, 1600.0)
    assert servos.targets(1.0 + 0.9 * SILENCE) == pytest.approx([math.nan, -0.2], nan_ok=True)
    assert np.isnan(servos.targets(1.0 + 1.1 * SILENCE)).all()


@settings(max_examples=50)
@given(st.tuples(*[st.floats(-1.4, 1.4)] * 3), st.integers(0, 1000))
def test_a_sensor_at_rest_feels_the_tilt(angles: tuple[float, float, float], seed: int) -> None:
    quaternion = Rotation.from_euler("zyx", angles).as_quat()
    up = felt(quaternion, np.zeros(3), 9.80665)
    assert np.linalg.norm(up) == pytest.approx(1.0)
    assert tilt_from(up) == pytest.approx(tilt_of(quaternion))
    mounting = Mounting.drawn(np.random.default_rng(seed))
    said = mounting.says(up)
    back = mounting.rotation.T @ ((said - mounting.bias) / mounting.scale)
    assert back == pytest.approx(up)


def test_who_falls_freely_feels_nothing() -> None:
    assert felt(np.array([0, 0, 0, 1.0]), np.array([0, 0, -9.81]), 9.81) == pytest.approx(np.zeros(3))


def test_a_limp_joint_is_held_by_nothing() -> None:
    with Simulation() as simulation:
        simulation.add("robot", load_robot("crawler"))
        simulation.command("robot", np.array([-1.0, 0.0]))
        simulation.step(120)
        assert simulation.joints("robot")[0] == pytest.approx(-1.0, abs=0.02)
        simulation.command("robot", np.array([math.nan, 0.0]))
        simulation.step(240)
        assert simulation.joints("robot")[0] > -0.1
        assert simulation.velocity("robot") == pytest.approx(np.zeros(3), abs=0.01)


def test_a_body_of_many_joints_cannot_be_built_with_these_boards() -> None:
    hand = drawn(
        parse_scenario(
            "name: many\nteachers: [{robot: hand, gait: finger_walk, distance: 1.2, bearing_deg: 40}]"
        ),
        0,
    )
    with pytest.raises(UserError, match="4 joints, an emulated board 2 servos"):
        EmulatedBench(hand)


# Time.


def test_time_passes_only_when_somebody_waits(bench: EmulatedBench) -> None:
    assert bench.now() == 0.0
    bench.sleep(0.0101)
    assert bench.now() == pytest.approx(0.0101)
    bench.sleep(-1.0)
    assert bench.now() == pytest.approx(0.0101)


def test_waiting_ends_with_the_answer_or_at_the_deadline(bench: EmulatedBench) -> None:
    board = board_of(bench)
    begun = bench.now()
    board.drive(np.array([1500.0, 1500.0]))
    assert 0.002 < bench.now() - begun < 0.004  # 12 bytes there and 38 back at 40 us
    port = board.port
    assert not bench.wait(port, bench.now() + 0.0203)
    assert bench.now() - begun > 0.0203
    assert bench.now() - begun < 0.025
    board.disconnect()


def history(here: Scenario, ports: Path, slices: int) -> tuple[bytes, list[object]]:
    """Where the student comes to be, and all pulses; time passes in so many slices a nap."""
    ports.mkdir()
    with EmulatedBench(here, seed=1, ports=ports) as bench:
        board = board_of(bench)
        for width in (1500.0, 1300.0, 1750.0):
            board.drive(np.array([width, 1500.0]))
            for _ in range(slices):
                bench.sleep(0.2 / slices)
        board.disconnect()
        base, joints = bench.state(STUDENT)
        return base.tobytes() + joints.tobytes(), [tuple(pulse) for pulse in bench.boards[STUDENT].pulses]


def test_the_same_happens_again_and_however_time_is_sliced(here: Scenario, tmp_path: Path) -> None:
    first = history(here, tmp_path / "a", 1)
    assert first == history(here, tmp_path / "b", 1)
    sliced = history(here, tmp_path / "c", 8)
    assert sliced[1] == first[1]
    assert np.frombuffer(sliced[0]) == pytest.approx(np.frombuffer(first[0]), abs=1e-6)
    assert len(first[1]) > 20


def test_four_boards_and_two_cameras_are_faster_than_real_time(bench: EmulatedBench) -> None:
    """With fifteen pairs of images a second; the processor's time, whoever else uses it."""
    bench.sleep(0.2)
    begun = time.process_time()
    for _ in range(15):
        bench.sleep(1 / 15)
        for camera in bench.cameras:
            frame = camera.newest()
            assert frame is not None
            assert frame.image.shape == (480, 640)
    assert time.process_time() - begun < 1.0


def test_something_happens_later(bench: EmulatedBench) -> None:
    happened: list[float] = []
    bench.later(0.1, lambda: happened.append(bench.now()))
    bench.sleep(0.09)
    assert not happened
    bench.sleep(0.1)
    assert happened == [pytest.approx(0.1, abs=1 / 240)]


# From bytes to motion.


def test_pulses_move_the_body_as_each_servo_takes_them(bench: EmulatedBench) -> None:
    board, servos = board_of(bench), bench.boards[STUDENT].servos.servos
    wanted = np.array([-0.5, 0.3])
    widths = [servo.width(angle) for servo, angle in zip(servos, wanted, strict=True)]
    feed(bench, board, widths, 0.5)
    assert bench.state(STUDENT)[1] == pytest.approx(wanted, abs=0.03)
    board.disconnect()
    bench.sleep(0.5)
    assert bench.boards[STUDENT].limp
    assert bench.state(STUDENT)[1][0] > -0.1


def test_the_rig_turns_by_its_servo_and_stays_where_it_was_let_go(bench: EmulatedBench) -> None:
    board, (servo,) = board_of(bench, RIG), bench.boards[RIG].servos.servos
    feed(bench, board, [servo.width(0.4)], 0.5)
    assert bench.pan == pytest.approx(0.4, abs=0.002)
    board.disconnect()
    bench.sleep(0.5)
    assert bench.pan == pytest.approx(0.4, abs=0.002)


# Hands.


def test_hands_lay_robots_as_they_are_asked_and_put_them_back(bench: EmulatedBench) -> None:
    hands = Hands(bench)
    fed: list[float] = []
    for orientation, expected in (("nose_down", (0.0, math.pi / 2)), ("left_side", (-math.pi / 2, 0.0))):
        question = Question("tilt", "teacher_0", "", {"orientation": orientation})
        assert hands(question, lambda: fed.append(bench.now())) == ""
        up = Rotation.from_quat(bench.state("teacher_0")[0][3:]).inv().apply([0, 0, 1])
        assert tilt_from(up)[int(orientation == "nose_down")] == pytest.approx(
            max(expected, key=abs), abs=0.05
        )
    assert np.diff(fed).max() < 0.25  # boards hear of somebody all the while
    start = bench.simulation.base("teacher_1")
    hands(Question("place", "teacher_0", ""))
    assert bench.state("teacher_0")[0][2] == pytest.approx(0.025, abs=0.002)
    assert bench.simulation.base("teacher_1") == pytest.approx(start, abs=1e-3)


def test_hands_read_angles_as_from_a_protractor(bench: EmulatedBench) -> None:
    board, servos = board_of(bench), bench.boards[STUDENT].servos.servos
    widths = [servo.width(math.radians(33.0)) for servo in servos]
    feed(bench, board, widths, 0.4)
    question = Question("servo_angle", STUDENT, "", {"joint": "joint_b", "pulse_us": widths[1]})

    def keep() -> None:
        board.drive(np.array(widths))

    answer = float(Hands(bench)(question, keep))
    assert answer == pytest.approx(33.0, abs=1.0)
    assert (2 * answer).is_integer()
    nudge = Question(
        "servo_nudge",
        STUDENT,
        "",
        {"joint": "joint_a", "angle_deg": -20.0, "pulse_us": 1500.0, "step_us": 10.0},
    )
    missing = servos[0].width(math.radians(-20.0)) - 1500.0
    assert int(Hands(bench)(nudge)) == round(missing / 10)


def test_hands_say_what_they_cannot_do(bench: EmulatedBench) -> None:
    with pytest.raises(UserError, match="cannot do 'dance'"):
        Hands(bench)(Question("dance", STUDENT, ""))
