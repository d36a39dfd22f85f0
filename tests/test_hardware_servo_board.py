"""The host's side of a robot against the shipped firmware on an emulated microcontroller, at a real port."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from one_board import JOINTS, UNIQUE, Peer, Table, address, servos, upright
from simavr_needed import simavr_or_skip

from testbed.hardware.board import Address, Board
from testbed.hardware.calibration import ServoCalibration, save_calibration
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.wire import Wire, WireFaults, garbage
from testbed.hardware.failures import (
    BoardRestarted,
    CalibrationForeign,
    HardwareFailure,
    ImuMissing,
    ImuStuck,
    LinkLost,
    NoAnswer,
    NotArmed,
    NotCalibrated,
    PortMissing,
    Stopped,
    TiltImplausible,
    WentLimp,
    WrongBoard,
    WrongFirmware,
    WrongProtocol,
)
from testbed.hardware.handshake import reset_cause
from testbed.hardware.protocol import REPLY, Flags, Frame, Request, Result, encode
from testbed.hardware.robot import Robot
from testbed.hardware.servo_board import BoardSettings, ServoBoard

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


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
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


@pytest.mark.parametrize(
    ("state", "kind"), [("unplugged", ImuMissing), ("bus dead", ImuMissing), ("stuck", ImuStuck)]
)
def test_a_tilt_sensor_that_fails_is_named(bench: Bench, state: str, kind: type[HardwareFailure]) -> None:
    robot = bench.ready()
    robot.act(np.zeros(2))
    bench.chip.set_imu(state)  # type: ignore[arg-type]
    with pytest.raises(kind, match="the tilt sensor of student"):
        bench.live(0.5)


def test_a_board_without_a_sensor_needs_none(bench: Bench) -> None:
    bench.chip.set_imu("unplugged")
    robot = ServoBoard(
        address(bench.wire),
        JOINTS,
        bench.table,
        calibrations=bench.folder / "calibrations",
        settings=BoardSettings(imu=False),
    )
    with robot:
        robot.connect()
        robot.configure()
        robot.arm()
        assert robot.act(np.zeros(2)).tilt is None


def test_a_sensor_that_reads_what_cannot_be_is_named(bench: Bench) -> None:
    bench.ready()
    bench.chip.set_acceleration(0, 0, 1.9)
    with pytest.raises(TiltImplausible, match=r"it feels 1\.9\d g, at rest it should be 1"):
        bench.live(0.5)


def test_a_sensor_that_jumps_while_nothing_moves_is_named_and_one_of_a_body_that_moves_is_not(
    bench: Bench,
) -> None:
    bench.ready()
    for step in range(30):  # moving: anything between .5 and 1.5 g is believed
        bench.chip.set_acceleration(*((0, 0, 1) if step % 2 else (0, 0.9, 0.4)))
        bench.live(2 * STEP, moving=True)
    bench.live(1.5)
    bench.chip.set_acceleration(0, 1, 0)
    with pytest.raises(TiltImplausible, match=r"it jumped by \d+ degrees while nothing moved"):
        bench.live(0.1)


def test_a_sensor_that_reads_wildly_is_named_also_while_the_body_moves(bench: Bench) -> None:
    bench.ready()
    rng = np.random.default_rng(8)

    def shake() -> None:
        bench.chip.set_acceleration(*rng.uniform(-2, 2, 3))
        bench.table.at(bench.table.now() + STEP, shake)

    shake()
    with pytest.raises(TiltImplausible):
        bench.live(4.0, moving=True)


def test_garbage_both_ways_costs_at_most_some_retries(bench: Bench) -> None:
    """10 kB each way."""
    robot, rng = bench.ready(), np.random.default_rng(9)
    robot.act(np.zeros(2))
    for _ in range(20):
        robot.board.port.write(garbage(rng, 500))
        bench.table.sleep(0.022)
        bench.wire.to_host(garbage(rng, 500), bench.table.now())
        assert robot.act(np.zeros(2)).flags & Flags.ARMED
    assert robot.board.raw(Request.READ).counters[1] > 20
    assert robot.board.statistics.framing > 20


@pytest.mark.parametrize("kind", ["drop", "flip", "double"])
@pytest.mark.parametrize(("rate", "most_lost"), [(0.001, 0), (0.01, 2), (0.03, 50), (0.1, 3)])
def test_on_a_bad_line_each_command_is_carried_out_or_lost_by_name(
    bench: Bench, kind: str, rate: float, most_lost: int
) -> None:
    robot = bench.ready()
    bench.wire.faults = WireFaults(**{kind: rate})
    lost, count, wanted = 0, 100 if rate < 0.1 else 3, np.zeros(2)
    for step in range(count):
        wanted = np.array([0.5 * math.sin(step / 10), 0.3 * math.cos(step / 7)])
        try:
            state = robot.act(wanted)
        except LinkLost:
            lost += 1
            continue
        except WentLimp:
            robot.arm()
            continue
        assert state.targets == pytest.approx(wanted, abs=HALF_US)
        bench.table.sleep(STEP)
    assert lost <= most_lost
    # Whatever went out lies between what was ever commanded.
    low, high = 1480 - 620 * 0.51, 1480 + 620 * 0.51
    assert all(low <= width <= high for width in bench.widths(0))


def peer_bench(tmp_path: Path) -> tuple[Peer, ServoBoard, Wire]:
    peer, wire = Peer(), Wire(tmp_path / "ttyP")
    return peer, ServoBoard(address(wire), JOINTS, Table((peer, wire))), wire


def test_another_protocol_and_another_firmware_are_named(tmp_path: Path) -> None:
    peer, robot, wire = peer_bench(tmp_path)
    peer.identity = replace(peer.identity, protocol=2)
    with pytest.raises(WrongProtocol, match="speaks protocol 2, this version speaks 1; flash the firmware"):
        robot.connect()
    peer.identity = replace(peer.identity, protocol=1, firmware=(2, 3, 4))
    with pytest.raises(WrongFirmware, match=r"has firmware 2\.3\.4, this version needs 1\.x; flash"):
        robot.connect()
    assert [frame.type for frame in peer.frames] == [Request.HELLO] * 2
    wire.close()


def test_a_board_that_refuses_what_it_should_know_is_named(tmp_path: Path) -> None:
    peer, robot, wire = peer_bench(tmp_path)
    robot.connect()
    peer.state = replace(peer.state, result=6)
    with pytest.raises(WrongFirmware, match=r"refuses STOP, which it should know \(result 6\)"):
        robot.stop()
    peer.state = replace(peer.state, result=0, servos=((0, 0),))
    with pytest.raises(LinkLost):
        robot.stop()
    robot.disconnect()
    wire.close()


def test_an_answer_to_what_noise_made_of_a_request_is_no_refusal(tmp_path: Path) -> None:
    peer, robot, wire = peer_bench(tmp_path)
    robot.connect()

    def answer(frame: Frame) -> list[tuple[float, bytes]]:
        """The first sending arrived with a byte more, which the CRC does not see."""
        first = sum(other == frame for other in peer.frames) == 1
        state = replace(peer.state, result=Result.BAD_LENGTH if first else Result.OK)
        return [(0.002, encode(frame.seq, frame.type | REPLY, state.encode()))]

    peer._answer = answer
    robot.stop()
    assert robot.board.statistics.misfits == 1
    robot.disconnect()
    wire.close()


def test_the_cause_of_a_reset_in_words() -> None:
    identity = Peer().identity
    assert (
        reset_cause(replace(identity, reset_cause=0b0101)) == "a brown-out"
    )  # power-on sets its own bit beside it
    assert reset_cause(replace(identity, reset_cause=0b1000)) == "a watchdog reset"
    assert reset_cause(replace(identity, reset_cause=0)) == "an unknown cause"
