"""The host's side of a robot against the shipped firmware on an emulated microcontroller, at a real port."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from one_board import JOINTS, address, servos, upright
from servo_bench import HALF_US, STEP, Bench, servo_bench

from testbed.hardware.failures import (
    LinkLost,
    NotArmed,
    NotCalibrated,
    Stopped,
    WentLimp,
)
from testbed.hardware.line.protocol import Flags
from testbed.hardware.robots.robot import Robot
from testbed.hardware.robots.servo_board import ServoBoard


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with servo_bench(tmp_path) as bench:
        yield bench


def test_what_is_commanded_goes_out_and_is_told_back(bench: Bench) -> None:
    robot: Robot = bench.ready()
    wanted = np.array([0.4, -0.7])
    state = robot.act(wanted)
    assert state.targets == pytest.approx(wanted, abs=HALF_US)
    assert state.applied == pytest.approx(wanted, abs=HALF_US)  # the first one goes out as it is
    assert state.flags & Flags.ARMED
    assert not state.clamped
    assert state.tilt == pytest.approx([0, 0], abs=0.02)
    bench.table.sleep(0.05)
    assert bench.widths(0)[-1] == pytest.approx(1480 + 620 * 0.4, abs=0.51)
    bench.table.sleep(0.05)
    assert robot.observe().at == bench.table.now()


def test_later_commands_go_through_the_slew_cap_and_what_is_applied_says_so(bench: Bench) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.table.sleep(0.1)
    state = robot.act(np.array([1.0, 0.0]))
    assert state.targets[0] == pytest.approx(1.0, abs=HALF_US)
    assert state.applied[0] < 0.2
    assert state.flags & Flags.SLEWING
    bench.chip.pulses()
    for _ in range(12):
        bench.table.sleep(STEP)
        state = robot.act(np.array([1.0, 0.0]))
    widths = bench.widths(0)
    assert max(np.diff(widths)) <= robot.settings.slew_us + 0.1
    assert state.applied[0] == pytest.approx(1.0, abs=HALF_US)


def test_no_pulse_before_the_first_command_and_none_after_the_end(bench: Bench) -> None:
    robot = bench.robot
    robot.connect()
    robot.configure()
    assert bench.quiet()
    robot.arm()
    assert np.isnan(robot.observe().applied).all()
    assert bench.quiet()
    robot.act(np.zeros(2))
    bench.table.sleep(0.1)
    assert bench.widths()
    robot.disconnect()
    robot.disconnect()
    assert bench.quiet()


@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt, None])
def test_it_is_limp_after_an_exception_ctrl_c_and_the_end_of_its_block(
    bench: Bench, kind: type[BaseException] | None
) -> None:
    def live() -> None:
        with bench.ready() as robot:
            robot.act(np.zeros(2))
            bench.table.sleep(0.1)
            if kind is not None:
                raise kind

    if kind is None:
        live()
    else:
        with pytest.raises(kind):
            live()
    assert bench.quiet()
    bench.robot.connect()  # the port is free
    with pytest.raises(NotCalibrated):
        bench.robot.act(np.zeros(2))


def test_ctrl_c_in_the_middle_of_an_exchange_leaves_it_limp(bench: Bench) -> None:
    def press() -> None:
        raise KeyboardInterrupt

    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.table.at(bench.table.now() + 0.001, press)
    with pytest.raises(KeyboardInterrupt), robot:
        robot.act(np.ones(2))
    assert bench.quiet()


def test_a_listener_that_fails_does_not_keep_it_from_going_limp(bench: Bench) -> None:
    full = False

    def listener(*heard: object) -> None:
        if full:
            raise NotCalibrated("stands for a full disk")

    robot = ServoBoard(address(bench.wire), JOINTS, bench.table, listener=listener)
    robot.connect()
    robot.calibrate(servos(), upright())
    robot.arm()
    robot.act(np.zeros(2))
    full = True
    with pytest.raises(NotCalibrated), robot:
        robot.act(np.zeros(2))
    assert bench.quiet()


def test_a_command_beyond_the_limits_is_clamped_and_reported(bench: Bench) -> None:
    robot = bench.ready()
    state = robot.act(np.array([2.0, -1e9]))
    assert state.clamped
    assert state.targets == pytest.approx(np.radians([80, -80]), abs=HALF_US)
    bench.table.sleep(0.1)
    assert max(bench.widths(0)) <= 1480 + 620 * math.radians(80) + 0.5
    assert not robot.act(np.array([1.0, 0.0])).clamped
    with pytest.raises(ValueError, match="cannot go for"):
        robot.act(np.array([math.nan, 0.0]))


def test_commands_before_arming_and_after_a_stop_are_refused_by_name(bench: Bench) -> None:
    robot = bench.robot
    with pytest.raises(NotCalibrated):
        robot.act(np.zeros(2))
    with pytest.raises(LinkLost, match="not connected"):
        robot.stop()
    robot.connect()
    with pytest.raises(NotCalibrated):
        robot.arm()
    robot.configure()
    with pytest.raises(NotArmed, match="student is not armed; arm it first"):
        robot.act(np.zeros(2))
    assert bench.quiet()
    robot.arm()
    with pytest.raises(NotArmed, match="armed, and should not be"):
        robot.configure()
    robot.act(np.zeros(2))
    robot.stop()
    assert bench.quiet()
    with pytest.raises(Stopped, match="release the stop button and power-cycle"):
        robot.act(np.zeros(2))
    robot.connect()  # neither a new connection nor clearing undoes it
    robot.configure()
    with pytest.raises(Stopped):
        robot.arm()
    assert bench.quiet()


def test_the_stop_button_is_named(bench: Bench) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.chip.press_stop()
    bench.table.sleep(STEP)
    with pytest.raises(Stopped):
        robot.act(np.zeros(2))
    assert bench.quiet()


def test_silence_is_borne_held_and_then_limp_by_name_until_it_is_armed_again(bench: Bench) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.table.sleep(0.5)
    assert robot.observe().flags & Flags.HOLDING
    assert robot.act(np.zeros(2)).flags & Flags.LATCHED_HELD
    bench.table.sleep(2.2)
    with pytest.raises(WentLimp, match="heard no command for too long"):
        robot.act(np.zeros(2))
    assert bench.quiet()
    robot.arm()
    assert not robot.act(np.zeros(2)).flags & (Flags.LATCHED_LIMP | Flags.LATCHED_HELD)


def test_what_the_watchdog_latched_is_forgotten_with_a_new_connection(bench: Bench) -> None:
    bench.ready().act(np.zeros(2))
    bench.table.sleep(2.2)
    bench.robot.connect()
    bench.robot.configure()
    assert not bench.robot.observe().flags & (Flags.LATCHED_LIMP | Flags.LATCHED_HELD)


def test_feeding_keeps_it_alive(bench: Bench) -> None:
    robot = bench.ready()
    state = robot.board.feed(np.array([1500.0, 1500.0]), 3.0)
    assert not state.flags & (Flags.HOLDING | Flags.LATCHED_HELD)
