"""What is plugged in: serial ports with the boards that answer there, and cameras with what they see."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import cv2
import numpy as np

from testbed.errors import UserError
from testbed.experiment.atomic import write_whole
from testbed.hardware.bench_file import RIG, BenchSpec, BoardSpec, CamerasSpec, is_agent
from testbed.hardware.clock import Clock
from testbed.hardware.failures import HardwareFailure
from testbed.hardware.line.handshake import ask
from testbed.hardware.line.ports import PortInfo, found_ports
from testbed.hardware.line.protocol import Identity
from testbed.hardware.rig.cameras import Image, VideoCamera, found_cameras
from testbed.world.placement import STUDENT

Progress = Callable[[int, int], None]
THUMBNAIL = (320, 240)


def silent(done: int, total: int) -> None:
    """Reports no progress."""


@dataclass(frozen=True)
class FoundPort:
    """A serial port and who answers there.

    Attributes:
        info: The port.
        identity: The board of our firmware that answers; None if none does.
        failure: Why not.
    """

    info: PortInfo
    identity: Identity | None
    failure: HardwareFailure | None


@dataclass(frozen=True)
class FoundCamera:
    """A camera and what it sees.

    Attributes:
        id: What to write into the bench file.
        size: Width and height of its images, pixels; None where it gives none.
        thumbnail: A small picture of what it sees now.
        failure: Why there is none.
    """

    id: str
    size: tuple[int, int] | None = None
    thumbnail: Path | None = None
    failure: HardwareFailure | None = None


def look_for_boards(globs: Iterable[str], clock: Clock, progress: Progress = silent) -> list[FoundPort]:
    """Every serial port, each asked who is there. Nothing moves by being asked.

    Opening its port restarts an Uno or a Nano: its servos go limp and its emergency stop is forgotten.
    """
    ports = found_ports(globs)
    found = []
    for number, info in enumerate(ports):
        progress(number, len(ports))
        try:
            found.append(FoundPort(info, ask(info.path, clock), None))
        except HardwareFailure as failure:
            found.append(FoundPort(info, None, failure))
    progress(len(ports), len(ports))
    return found


def look_for_cameras(
    sources: Iterable[str], folder: Path, clock: Clock, progress: Progress = silent
) -> list[FoundCamera]:
    """Every camera that is plugged in, and further ``sources``, each with a thumbnail in a folder.

    Raises:
        UserError: If the folder cannot be written.
    """
    names = list(dict.fromkeys([*(camera.id for camera in found_cameras()), *sources]))
    found = []
    for number, name in enumerate(names):
        progress(number, len(names))
        found.append(_looked_through(name, folder / f"camera-{number}.png", clock))
    progress(len(names), len(names))
    return found


def _looked_through(name: str, thumbnail: Path, clock: Clock) -> FoundCamera:
    try:
        camera = VideoCamera(name, clock, size=(640, 480) if name.startswith("/dev/") else None)
    except HardwareFailure as failure:
        return FoundCamera(name, failure=failure)
    try:
        frame = camera.newest()
        if frame is None:
            return FoundCamera(name)
        small = cv2.resize(frame.image, THUMBNAIL, interpolation=cv2.INTER_AREA)
        write_picture(np.asarray(small, dtype=np.uint8), thumbnail)
        return FoundCamera(name, (frame.image.shape[1], frame.image.shape[0]), thumbnail)
    except HardwareFailure as failure:
        return FoundCamera(name, failure=failure)
    finally:
        camera.close()


def write_picture(image: Image, path: Path) -> None:
    """An image (H, W) or (H, W, 3; blue, green, red) as PNG, whole or not at all.

    Raises:
        UserError: If the place cannot be written.
    """
    whole, coded = cv2.imencode(".png", image)
    assert whole, "OpenCV writes PNG"
    write_whole(path, lambda file: _write(file, coded.tobytes()))


def _write(file: IO[bytes], contents: bytes) -> None:
    file.write(contents)


def begun(ports: Iterable[FoundPort], cameras: Iterable[FoundCamera], globs: tuple[str, ...]) -> BenchSpec:
    """The bench file that fits what was found: boards by the names that they were given, the first two cameras.

    Raises:
        UserError: If no board has the name of an agent, or two have the same.
    """
    boards: dict[str, BoardSpec] = {}
    for identity in (port.identity for port in ports if port.identity is not None):
        if not is_agent(identity.board_id):
            continue
        if identity.board_id in boards:
            what = f"two boards are named '{identity.board_id}'"
            raise UserError(what, "give one of them another name: testbed hardware name PORT teacher_1")
        boards[identity.board_id] = BoardSpec(unique_id=identity.unique_id)
    if not boards:
        raise UserError(
            "no board is named after an agent yet", f"name them first: testbed hardware name PORT {STUDENT}"
        )
    seeing = [camera.id for camera in cameras if camera.thumbnail is not None]
    eyes = CamerasSpec(left=seeing[0], right=seeing[1]) if len(seeing) > 1 else None
    ordered = dict(sorted(boards.items(), key=lambda item: (item[0] != STUDENT, item[0] == RIG, item[0])))
    return BenchSpec(boards=ordered, cameras=eyes, port_globs=globs)


def as_rows(ports: Iterable[FoundPort]) -> Iterator[dict[str, object]]:
    """The ports as plain data."""
    for port in ports:
        info, board = port.info, port.identity
        yield {
            "port": info.path,
            "vendor": info.vendor,
            "product": info.product,
            "serial_number": info.serial_number,
            "description": info.description,
            "name": board and board.board_id,
            "unique_id": board and board.unique_id,
            "firmware": board and ".".join(map(str, board.firmware)),
            "protocol": board and board.protocol,
            "servos": board and len(board.limits),
            "imu": board and bool(board.imu),
            "failure": port.failure and port.failure.outcome,
            "why": port.failure and str(port.failure),
        }
