"""Readings that cannot be, lines that garble, boards that speak otherwise: each by its name."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from one_board import JOINTS, Peer, Table, address
from servo_bench import HALF_US, STEP, Bench, servo_bench

from testbed.hardware.emulation.wire import Wire, WireFaults, garbage
from testbed.hardware.failures import (
    HardwareFailure,
    ImuMissing,
    ImuStuck,
    LinkLost,
    TiltImplausible,
    WentLimp,
    WrongFirmware,
    WrongProtocol,
)
from testbed.hardware.line.handshake import reset_cause
from testbed.hardware.line.protocol import REPLY, Flags, Frame, Request, Result, encode
from testbed.hardware.robots.servo_board import BoardSettings, ServoBoard


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with servo_bench(tmp_path) as bench:
        yield bench


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
