"""The emergency stop of everything that can be reached."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from testbed.hardware.bench_file import BenchSpec
from testbed.hardware.clock import Clock
from testbed.hardware.failures import HardwareFailure, PortMissing
from testbed.hardware.line.bus import BUS_BAUD, FeetechLine, Register
from testbed.hardware.line.link import Link
from testbed.hardware.line.ports import found_ports, open_port
from testbed.hardware.line.protocol import Flags, Request, State
from testbed.hardware.operating.workbench import address_of, bus_ids, clock_of, joints_of
from testbed.hardware.robots.feetech import adapter_path

POWER_CUT = "cut the servos' power by the switch"
_PATIENCE = 3.0  # s; a board that is reset by the opening of its port takes two to wake up


@dataclass(frozen=True)
class Stopping:
    """What became of the emergency stop at one port.

    Attributes:
        port: Where.
        board: The agent of the bench file, or "".
        stopped: Whether a board there says that it is stopped, or all servos of a bus that they let go.
        why: Why not.
    """

    port: str
    board: str
    stopped: bool
    why: str = ""


def stop_everything(spec: BenchSpec | None) -> list[Stopping]:
    """Send STOP to every serial port there is, all at the same time; nothing is asked before.

    What is stopped stays so until the board is reset or its power is cut. Bus servos know no stop that lasts: they
    are told to let go.
    """
    named = {} if spec is None else {board.port: name for name, board in spec.boards.items() if board.port}
    buses = {} if spec is None else _buses(spec)
    ports = found_ports(() if spec is None else spec.port_globs)
    paths = list(dict.fromkeys([*(port.path for port in ports), *named, *buses]))
    if not paths:
        raise PortMissing("there is no serial port to send a stop to", POWER_CUT)
    clock = clock_of(spec)

    def stopped(path: str) -> Stopping:
        if path in buses:
            return _let_go(path, *buses[path], clock)
        return _stopped(path, named.get(path, ""), clock)

    with ThreadPoolExecutor(len(paths)) as everywhere:
        return list(everywhere.map(stopped, paths))


def _buses(spec: BenchSpec) -> dict[str, tuple[str, list[int]]]:
    """By port of an adapter that is plugged in: the agent, and the numbers of its servos."""
    found = {}
    for agent, board in spec.boards.items():
        if board.build == "feetech":
            try:
                path = adapter_path(address_of(spec, agent))
            except PortMissing:
                continue
            found[path] = agent, list(bus_ids(joints_of(spec, agent)).values())
    return found


def _stopped(path: str, name: str, clock: Clock) -> Stopping:
    try:
        link = Link(open_port(path), clock, name=name or path)
    except HardwareFailure as failure:
        return Stopping(path, name, False, str(failure))
    try:
        deadline = clock.now() + _PATIENCE
        while True:
            try:
                state = State.decode(link.request(Request.STOP, retries=0).body)
                return Stopping(path, name, bool(state.flags & Flags.STOPPED))
            except HardwareFailure as failure:
                if clock.now() >= deadline:
                    return Stopping(path, name, False, str(failure))
            except ValueError:
                return Stopping(path, name, False, "something else than a board of ours answers")
    finally:
        link.close()


def _let_go(path: str, name: str, servos: list[int], clock: Clock) -> Stopping:
    try:
        line = FeetechLine(open_port(path, baud=BUS_BAUD), clock, name=name)
    except HardwareFailure as failure:
        return Stopping(path, name, False, str(failure))
    try:
        line.write_all(Register.TORQUE_ENABLE, dict.fromkeys(servos, b"\0"))
        for servo in servos:  # a broadcast has no answer
            line.write(servo, Register.TORQUE_ENABLE, b"\0")
            if line.read(servo, Register.TORQUE_ENABLE, 1) != b"\0":
                return Stopping(path, name, False, f"servo {servo} still pulls")
        return Stopping(path, name, True)
    except HardwareFailure as failure:
        return Stopping(path, name, False, str(failure))
    finally:
        line.close()
