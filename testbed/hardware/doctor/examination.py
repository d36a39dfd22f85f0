"""The doctor: everything that can be checked on a bench without moving anything."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from testbed.hardware.bench_file import RIG
from testbed.hardware.doctor.boards import READS, BoardDoctor, machine_checks
from testbed.hardware.doctor.bus import BusDoctor
from testbed.hardware.doctor.cameras import camera_checks
from testbed.hardware.doctor.checks import Check, failed, skipped
from testbed.hardware.failures import HardwareFailure
from testbed.hardware.operating.workbench import Workbench, bus_ids, imu_of, joints_of
from testbed.vision.camera import StereoRig

Progress = Callable[[int, int], None]
_CHECKS_OF_A_BOARD = 7  # some; only the progress bar wants to know
_CHECKS_OF_CAMERAS = 8


def examine(
    place: Workbench,
    *,
    reads: int = READS,
    show_board: bool = False,
    eyes: StereoRig | None = None,
    progress: Progress = lambda done, total: None,
) -> list[Check]:
    """All checks of a bench.

    Args:
        place: The bench.
        reads: How many exchanges each line is judged by.
        show_board: Whether to ask for the printed board.
        eyes: The rig of a scenario that is to be run.
        progress: Told how far it is.
    """
    checks: list[Check] = []
    total = 2 + _CHECKS_OF_A_BOARD * len(place.spec.boards) + _CHECKS_OF_CAMERAS
    for check in _one_after_the_other(place, reads, show_board, eyes):
        checks.append(check)
        progress(min(len(checks), total), total)
    progress(total, total)
    return checks


def _one_after_the_other(
    place: Workbench, reads: int, show_board: bool, eyes: StereoRig | None
) -> Iterator[Check]:
    spec = place.spec
    yield from machine_checks(spec.port_globs)
    for agent, board in spec.boards.items():
        address, folder = place.address(agent), spec.calibration_folder
        if board.build == "feetech":
            servos, imu = bus_ids(joints_of(spec, agent)), imu_of(spec, agent)
            yield from BusDoctor(address, servos, place.clock, folder, imu=imu, reads=reads).checks()
        else:
            doctor = BoardDoctor(address, place.clock, folder, imu=agent != RIG, reads=reads)
            yield from doctor.checks()
    if spec.cameras is None:
        yield skipped("cameras", "cameras", "the bench file names none")
        return
    with contextlib.ExitStack() as opened:
        try:
            cameras = place.cameras()
        except HardwareFailure as failure:
            yield failed("cameras", "cameras", failure)
            return
        for camera in cameras:
            opened.callback(camera.close)
        ask = place.prompt if show_board else None
        yield from camera_checks(cameras, place.clock, spec.calibration_folder, ask, eyes)
