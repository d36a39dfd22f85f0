"""What the commands work on: a bench with its clock, its boards, its cameras and whoever stands beside it.

A bench is named by its file, or by the word ``emulated``: the emulated one in virtual time, inside this process.
"""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from testbed.experiment.runner import OnBench
from testbed.hardware.bench_file import PAN, RIG, BenchSpec, BoardSpec, load_bench
from testbed.hardware.bench_time import BenchTime
from testbed.hardware.board import Address
from testbed.hardware.cameras import Camera, VideoCamera
from testbed.hardware.clock import Clock, WallClock
from testbed.hardware.failures import CameraMissing, HardwareFailure, PortMissing
from testbed.hardware.hands import DistantHands
from testbed.hardware.link import Link, Listener, deaf
from testbed.hardware.ports import found_ports, open_port
from testbed.hardware.prompt import Prompt, console
from testbed.hardware.protocol import Flags, Request, State
from testbed.hardware.robot import Robot
from testbed.hardware.servo_board import BoardSettings, ServoBoard
from testbed.morphology import load_robot

EMULATED = "emulated"
"""In place of a bench file: the emulated bench in virtual time."""
EMULATED_CALIBRATIONS = Path("emulated-bench") / "virtual-calibrations"
"""Where those of the bench in virtual time are kept; they are good for every run, for it always is the same bench."""
POWER_CUT = "cut the servos' power by the switch"
_STOP_PATIENCE = 3.0  # s; a board that is reset by the opening of its port takes two to wake up


@dataclass(frozen=True)
class Workbench:
    """A bench that a command works on.

    Attributes:
        spec: Its file.
        clock: Its time.
        prompt: Whoever stands beside it.
        cameras: Opens the left and the right camera; the caller closes them.
    """

    spec: BenchSpec
    clock: Clock
    prompt: Prompt
    cameras: Callable[[], tuple[Camera, Camera]]

    def robot(self, agent: str, listener: Listener = deaf) -> Robot:
        """An agent's robot, not yet connected."""
        return robot_of(self.spec, agent, joints_of(self.spec, agent), self.clock, listener)

    def address(self, agent: str) -> Address:
        """Where an agent's board is looked for."""
        return address_of(self.spec, agent)


@contextlib.contextmanager
def workbench(bench: str) -> Iterator[Workbench]:
    """A bench by its file, or ``emulated``.

    Raises:
        UserError: If the file is wrong, or the emulated bench cannot be built here.
    """
    if bench != EMULATED:
        spec = load_bench(bench)
        clock = clock_of(spec)
        yield Workbench(spec, clock, prompt_of(spec), lambda: cameras_of(spec, clock))
        return
    from testbed.hardware.emulation.bench import EmulatedBench
    from testbed.hardware.stage import workbench_of
    from testbed.scenario import drawn, load_scenario

    with (
        tempfile.TemporaryDirectory(prefix="bench-") as ports,
        EmulatedBench(drawn(load_scenario("bench"), 0), ports=Path(ports)) as emulated,
    ):
        yield workbench_of(emulated, Path(ports), EMULATED_CALIBRATIONS)


def prompt_of(spec: BenchSpec) -> Prompt:
    """Whoever stands beside a bench: a person at this terminal, or the hands of an emulated one."""
    return console if spec.hands is None else DistantHands(Path(spec.hands))


def clock_of(spec: BenchSpec | None) -> Clock:
    """The time of a bench: ours, or an emulated one's own.

    Raises:
        UserError: If the emulated bench is not running.
    """
    return WallClock() if spec is None or spec.clock is None else BenchTime(Path(spec.clock))


def address_of(spec: BenchSpec, agent: str) -> Address:
    """Where an agent's board is looked for.

    Raises:
        UserError: If the bench has none.
    """
    board = spec.board(agent)
    return Address(name=agent, unique_id=board.unique_id, port=board.port, globs=spec.port_globs)


def joints_of(spec: BenchSpec, agent: str) -> tuple[str, ...]:
    """The joints that an agent's board moves, in the order of its channels."""
    return (PAN,) if agent == RIG else tuple(load_robot(spec.board(agent).robot).joints)


def robot_of(
    spec: BenchSpec, agent: str, joints: Sequence[str], clock: Clock, listener: Listener = deaf
) -> Robot:
    """An agent's robot, not yet connected, whatever it is built of.

    Raises:
        UserError: If the bench has none.
    """
    board = spec.board(agent)
    address, folder = address_of(spec, agent), spec.calibration_folder
    if board.build == "feetech":
        return _feetech(board, address, joints, clock, folder, listener)
    settings = BoardSettings(imu=agent != RIG)
    return ServoBoard(address, joints, clock, calibrations=folder, listener=listener, settings=settings)


def _feetech(
    board: BoardSpec, address: Address, joints: Sequence[str], clock: Clock, folder: Path, listener: Listener
) -> Robot:
    from testbed.hardware.feetech import FeetechRobot

    servos = {joint: number for number, joint in enumerate(joints, 1)}
    imu = None
    if board.imu is not None:
        port, own = (board.imu, None) if "/" in board.imu else (None, board.imu)
        imu = Address(name=address.name, port=port, unique_id=own, globs=address.globs)
    return FeetechRobot(address, servos, clock, imu=imu, calibrations=folder, listener=listener)


def cameras_of(spec: BenchSpec, clock: Clock) -> tuple[Camera, Camera]:
    """The left and the right camera.

    Raises:
        CameraMissing: If one cannot be opened, or the bench has none.
    """
    if spec.cameras is None:
        raise CameraMissing("the bench file names no cameras", "add 'cameras: {left: ..., right: ...}' to it")
    left = VideoCamera(spec.cameras.left, clock)
    try:
        return left, VideoCamera(spec.cameras.right, clock)
    except BaseException:
        left.close()
        raise


@dataclass(frozen=True)
class Stopping:
    """What became of the emergency stop at one port.

    Attributes:
        port: Where.
        board: The agent of the bench file, or "".
        stopped: Whether a board there says that it is stopped.
        why: Why not.
    """

    port: str
    board: str
    stopped: bool
    why: str = ""


def stop_everything(spec: BenchSpec | None) -> list[Stopping]:
    """Send STOP to every serial port there is, all at the same time; nothing is asked before.

    What is stopped stays so until the board is reset or its power is cut.
    """
    named = {} if spec is None else {board.port: name for name, board in spec.boards.items() if board.port}
    globs = () if spec is None else spec.port_globs
    ports = dict.fromkeys([*(port.path for port in found_ports(globs)), *named])
    if not ports:
        raise PortMissing("there is no serial port to send a stop to", POWER_CUT)
    clock = clock_of(spec)
    with ThreadPoolExecutor(len(ports)) as everywhere:
        return list(everywhere.map(lambda path: _stopped(path, named.get(path, ""), clock), ports))


def _stopped(path: str, name: str, clock: Clock) -> Stopping:
    try:
        link = Link(open_port(path), clock, name=name or path)
    except HardwareFailure as failure:
        return Stopping(path, name, False, str(failure))
    try:
        deadline = clock.now() + _STOP_PATIENCE
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


def stage_of(bench: str) -> OnBench:
    """Where ``testbed run --backend hardware`` runs.

    Raises:
        UserError: If the bench file is wrong.
    """
    from testbed.hardware.stage import on_bench, on_emulated_bench

    if bench == EMULATED:
        stage = on_emulated_bench(EMULATED_CALIBRATIONS)
        known = _fingerprints(EMULATED_CALIBRATIONS)
        return OnBench(stage, {"bench": "emulated, in virtual time", "calibrations": known})
    spec = load_bench(bench)
    clock = clock_of(spec)
    place = Workbench(spec, clock, prompt_of(spec), lambda: cameras_of(spec, clock))
    boards = {agent: board.unique_id or board.port for agent, board in spec.boards.items()}
    calibrations = _fingerprints(spec.calibration_folder)
    return OnBench(on_bench(place), {"bench": spec.name, "boards": boards, "calibrations": calibrations})


def _fingerprints(folder: Path) -> dict[str, str]:
    """By file, eight digits that tell one calibration from another."""
    files = sorted(path for path in folder.glob("*") if path.suffix in (".yaml", ".npz"))
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest()[:8] for path in files}
