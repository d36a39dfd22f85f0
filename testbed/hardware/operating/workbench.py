"""What the commands work on: a bench with its clock, its boards, its cameras and whoever stands beside it.

A bench is named by its file, or by the word ``emulated``: the emulated one in virtual time, inside this process.
"""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbed.bodies.morphology import load_robot
from testbed.experiment.runner import OnBench
from testbed.hardware.bench_file import PAN, RIG, BenchSpec, load_bench
from testbed.hardware.bench_time import BenchTime
from testbed.hardware.clock import Clock, WallClock
from testbed.hardware.failures import CameraMissing
from testbed.hardware.line.link import Listener, deaf
from testbed.hardware.operating.hands import DistantHands
from testbed.hardware.prompt import Prompt, console
from testbed.hardware.rig.cameras import Camera, VideoCamera
from testbed.hardware.robots.board import Address
from testbed.hardware.robots.robot import Robot
from testbed.hardware.robots.servo_board import BoardSettings, ServoBoard

EMULATED = "emulated"
"""In place of a bench file: the emulated bench in virtual time."""
EMULATED_CALIBRATIONS = Path("emulated-bench") / "virtual-calibrations"
"""Where those of the bench in virtual time are kept; they are good for every run, for it always is the same bench."""


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
    from testbed.hardware.operating.stage import workbench_of
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
        return _feetech(address, joints, clock, folder, imu_of(spec, agent), listener)
    settings = BoardSettings(imu=agent != RIG)
    return ServoBoard(address, joints, clock, calibrations=folder, listener=listener, settings=settings)


def bus_ids(joints: Sequence[str]) -> dict[str, int]:
    """By joint, the number of its servo on a bus: 1, 2, ... in the body's order."""
    return {joint: number for number, joint in enumerate(joints, 1)}


def imu_of(spec: BenchSpec, agent: str) -> Address | None:
    """Where the board is looked for that carries the tilt sensor of a robot of bus servos."""
    imu = spec.board(agent).imu
    if imu is None:
        return None
    port, own = (imu, None) if "/" in imu else (None, imu)
    return Address(name=f"{agent}'s sensor", port=port, unique_id=own, globs=spec.port_globs)


def _feetech(
    address: Address,
    joints: Sequence[str],
    clock: Clock,
    folder: Path,
    imu: Address | None,
    listener: Listener,
) -> Robot:
    from testbed.hardware.robots.feetech import FeetechRobot

    return FeetechRobot(address, bus_ids(joints), clock, imu=imu, calibrations=folder, listener=listener)


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


def stage_of(bench: str) -> OnBench:
    """Where ``testbed run --backend hardware`` runs.

    Raises:
        UserError: If the bench file is wrong.
    """
    from testbed.hardware.operating.stage import on_bench, on_emulated_bench

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
