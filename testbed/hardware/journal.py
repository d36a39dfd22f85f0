"""What happened in a trial, written down while it happens: every frame and every step.

A file that only grows: records of a length, a CRC-32 and a payload. What a killed process or a power cut leaves
half-written at the end is dropped; everything before it stays. Damage in the middle is said to be there.
"""

from __future__ import annotations

import binascii
import contextlib
import os
import re
import struct
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import write_refused
from testbed.hardware.journal_records import KINDS, Lost, Note, Places, Record, Step, Wire, decoded, encoded

__all__ = [
    "Journal",
    "Lost",
    "Note",
    "Places",
    "Record",
    "Step",
    "Wire",
    "read_journal",
    "steps_of",
    "whole_steps",
]

MAGIC = b"bench journal 1\n"
_HEAD = struct.Struct("<LL")
_LIKELY = re.compile(rb"(?=...[\0\1].{4}[" + KINDS + b"])", re.DOTALL)  # a length, a CRC, a kind
_LARGEST = 1 << 24  # a step with images has 15 kB
_FLUSHED_EACH = 1.0  # s
_BUFFERED = 1 << 16


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
        """Write down a frame; a :data:`~testbed.hardware.line.link.Listener`."""
        self._append(encoded(Wire(at, board, direction, data)))

    def step(self, step: Step) -> None:
        """Write down a step."""
        self._append(encoded(step))

    def places(self, places: Places) -> None:
        """Write down where everybody really is."""
        self._append(encoded(places))

    def note(self, at: float, kind: str, text: str) -> None:
        """Write down something in words."""
        self._append(encoded(Note(at, kind, text)))

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

    Where the file is damaged in the middle, a :class:`Lost` stands for what cannot be read.

    Raises:
        UserError: If there is no such file or it is no journal.
    """
    records: list[Record] = []
    for piece in _pieces(_contents(path), path)[0]:
        at = records[-1].at if records else 0.0
        records.append(decoded(piece) if isinstance(piece, bytes) else Lost(at, piece))
    return records


def steps_of(records: list[Record]) -> list[Step]:
    """The steps as they count: all up to the first that is lost.

    One that was made again, by a trial that went back a little, replaces the older.
    """
    return whole_steps(records)[0]


def whole_steps(records: list[Record]) -> tuple[list[Step], bool]:
    """The same, and whether these are all that there were."""
    steps: list[Step] = []
    all_there = True
    for record in records:
        if isinstance(record, Step):
            while steps and steps[-1].number >= record.number:
                steps.pop()
            if all_there := record.number == len(steps):
                steps.append(record)
    return steps, all_there


def _whole(path: Path) -> int:
    """Where the last whole record of a file ends; 0 if there is no file yet."""
    return _pieces(_contents(path), path)[1] if path.exists() else 0


def _contents(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = os.strerror(error.errno or 0).lower()
        raise UserError(f"the journal cannot be read ({reason})", "check the name", file=path) from None


def _pieces(contents: bytes, path: Path) -> tuple[list[bytes | int], int]:
    """The payloads, between them how many bytes are damaged there; and where the last of them ends."""
    if not contents.startswith(MAGIC):
        if MAGIC.startswith(contents):  # killed before its first flush was whole
            return [], 0
        raise UserError("this is no journal, or one of another version", "name another file", file=path)
    pieces: list[bytes | int] = []
    end = len(MAGIC)
    while True:
        if (payload := _payload(contents, end)) is not None:
            pieces.append(payload)
            end += _HEAD.size + len(payload)
        elif (found := _next(contents, end)) is not None:
            pieces.append(found - end)
            end = found
        else:
            return pieces, end


def _payload(contents: bytes, at: int) -> bytes | None:
    """What the record at this byte holds; None if there is no whole one."""
    if at + _HEAD.size > len(contents):
        return None
    size, crc = _HEAD.unpack_from(contents, at)
    # A power cut can leave zeros where data should be: a record is never empty.
    if not 0 < size <= min(_LARGEST, len(contents) - at - _HEAD.size):
        return None
    payload = contents[at + _HEAD.size : at + _HEAD.size + size]
    return payload if binascii.crc32(payload) == crc else None


def _next(contents: bytes, after: int) -> int | None:
    """Where the next whole record begins behind damage."""
    places = (found.start() for found in _LIKELY.finditer(contents, after + 1))
    return next((place for place in places if _payload(contents, place) is not None), None)
