"""What happened in a trial, written down while it happens: every frame and every step.

A file that only grows: records of a length, a CRC-32 and a payload. What a killed process or a power cut leaves
half-written at the end is dropped; everything before it stays. Floating-point numbers are kept to the bit.
"""

from __future__ import annotations

import binascii
import contextlib
import json
import os
import struct
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import write_refused
from testbed.parts import Vector

MAGIC = b"bench journal 1\n"
_HEAD = struct.Struct("<LL")
_WIRE = struct.Struct("<dBB")
_LARGEST = 1 << 24  # a step with images has 15 kB
_FLUSHED_EACH = 1.0  # s
_BUFFERED = 1 << 16
_DIRECTIONS = ("sent", "received")


@dataclass(frozen=True)
class Wire:
    """A frame, or what was none, on a board's line.

    Attributes:
        at: When, s on the bench's clock.
        board: Whose line.
        direction: ``sent`` or ``received``, as the host sees it.
        data: The bytes with their delimiters.
    """

    at: float
    board: str
    direction: str
    data: bytes


@dataclass(frozen=True)
class Step:
    """A control step.

    Attributes:
        number: Counted from the trial's beginning; 0 is what was found there, before any command.
        at: When it was over, s on the bench's clock.
        commands: Per agent what its joints were told, rad.
        pan_command: What the rig was told, rad.
        pan: Where the rig looks after it, rad.
        tilts: Per agent (2,) rad.
        movement: Of the student, rad/s.
        exposed: The step in which the images that are seen now were exposed.
        images: (2, 75, 100) uint8 if they are new in this step.
    """

    number: int
    at: float
    commands: Mapping[str, Vector]
    pan_command: float
    pan: float
    tilts: Mapping[str, Vector]
    movement: float
    exposed: int
    images: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Note:
    """Anything else that is worth knowing, in words: of which kind, and when."""

    at: float
    kind: str
    text: str


Record = Wire | Step | Note


class Journal:
    """Writes a journal; one that is there already is gone on with. Use as a context manager, or :meth:`close`.

    Args:
        path: The file; its folder is made where it is missing.

    Raises:
        UserError: If the disk is full, the place cannot be written, or the file is no journal. What was written
            before stays.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._buffer = bytearray()
        self._flushed = time.monotonic()
        self._file: int | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            kept = _whole(path)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            os.ftruncate(self._file, kept)
            os.lseek(self._file, kept, os.SEEK_SET)
        except OSError as error:
            self._let_go()
            raise write_refused(path, error) from error
        if not kept:
            self._buffer += MAGIC

    def wire(self, at: float, board: str, direction: str, data: bytes) -> None:
        """Write down a frame; a :data:`~testbed.hardware.link.Listener`."""
        name = board.encode()
        head = _WIRE.pack(at, _DIRECTIONS.index(direction), len(name))
        self._append(b"W" + head + name + data)

    def step(self, step: Step) -> None:
        """Write down a step."""
        commands = {name: np.asarray(angles).tolist() for name, angles in step.commands.items()}
        tilts = {name: np.asarray(tilt).tolist() for name, tilt in step.tilts.items()}
        plain = {
            "number": int(step.number),
            "at": float(step.at),
            "commands": commands,
            "pan_command": float(step.pan_command),
            "pan": float(step.pan),
            "tilts": tilts,
            "movement": float(step.movement),
            "exposed": int(step.exposed),
        }
        images = b""
        if step.images is not None:
            plain["images"] = step.images.shape
            images = zlib.compress(np.ascontiguousarray(step.images, dtype=np.uint8).tobytes(), 1)
        head = json.dumps(plain).encode()
        self._append(b"S" + struct.pack("<L", len(head)) + head + images)

    def note(self, at: float, kind: str, text: str) -> None:
        """Write down something in words."""
        self._append(b"N" + json.dumps({"at": float(at), "kind": kind, "text": text}).encode())

    def flush(self) -> None:
        """Hand everything to the operating system, which keeps it even if this process is killed."""
        self._flushed = time.monotonic()
        if self._file is None:
            return
        try:
            while self._buffer:
                done = os.write(self._file, self._buffer)
                del self._buffer[:done]
        except OSError as error:
            # Half a record stays as the torn tail that readers drop; nothing more can be written.
            self._let_go()
            raise write_refused(self.path, error) from error

    def close(self) -> None:
        """Flush to the disk and let go; harmless when repeated."""
        self.flush()
        if self._file is not None:
            with contextlib.suppress(OSError):  # a place without fsync
                os.fsync(self._file)
        self._let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _append(self, payload: bytes) -> None:
        if self._file is None:
            raise UserError(f"the journal {shown_path(self.path)} is closed", "the first error says why")
        self._buffer += _HEAD.pack(len(payload), binascii.crc32(payload)) + payload
        if len(self._buffer) > _BUFFERED or time.monotonic() - self._flushed > _FLUSHED_EACH:
            self.flush()

    def _let_go(self) -> None:
        file, self._file = self._file, None
        self._buffer.clear()
        if file is not None:
            os.close(file)


def read_journal(path: Path) -> list[Record]:
    """Everything that was written down, in its order; a torn end is left out.

    Raises:
        UserError: If there is no such file or it is no journal.
    """
    return [_record(payload) for payload in _payloads(_contents(path), path)[0]]


def steps_of(records: list[Record]) -> list[Step]:
    """The steps as they count: one that was made again, by a trial that went back a little, replaces the older."""
    steps: list[Step] = []
    for record in records:
        if isinstance(record, Step):
            while steps and steps[-1].number >= record.number:
                steps.pop()
            steps.append(record)
    return steps


def _whole(path: Path) -> int:
    """How many bytes of a file are whole records; 0 if there is no file yet."""
    return _payloads(_contents(path), path)[1] if path.exists() else 0


def _contents(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = os.strerror(error.errno or 0).lower()
        raise UserError(f"the journal cannot be read ({reason})", "check the name", file=path) from None


def _payloads(contents: bytes, path: Path) -> tuple[list[bytes], int]:
    if not contents.startswith(MAGIC):
        if MAGIC.startswith(contents):  # killed before its first flush was whole
            return [], 0
        raise UserError("this is no journal, or one of another version", "name another file", file=path)
    payloads, at = [], len(MAGIC)
    while at + _HEAD.size <= len(contents):
        size, crc = _HEAD.unpack_from(contents, at)
        payload = contents[at + _HEAD.size : at + _HEAD.size + size]
        # A power cut can leave zeros where data should be: a record is never empty.
        if not 0 < size <= _LARGEST or len(payload) < size or binascii.crc32(payload) != crc:
            break
        payloads.append(payload)
        at += _HEAD.size + size
    return payloads, at


def _record(payload: bytes) -> Record:
    kind, rest = payload[:1], payload[1:]
    if kind == b"W":
        at, direction, length = _WIRE.unpack_from(rest)
        name, data = rest[_WIRE.size : _WIRE.size + length], rest[_WIRE.size + length :]
        return Wire(at, name.decode(), _DIRECTIONS[direction], data)
    if kind == b"N":
        return Note(**json.loads(rest))
    (length,) = struct.unpack_from("<L", rest)
    plain = json.loads(rest[4 : 4 + length])
    for key in ("commands", "tilts"):
        plain[key] = {name: np.array(values, dtype=float) for name, values in plain[key].items()}
    if (shape := plain.pop("images", None)) is not None:
        plain["images"] = np.frombuffer(zlib.decompress(rest[4 + length :]), np.uint8).reshape(shape)
    return Step(**plain)
