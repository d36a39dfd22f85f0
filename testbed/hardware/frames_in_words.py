"""A journal in words: what it holds, and every frame that went over a wire."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from testbed.errors import shown_path
from testbed.hardware.journal import Lost, Note, Step, Wire, read_journal, whole_steps
from testbed.hardware.line.protocol import REPLY, Flags, Frame, Identity, Parser, Request, Result, State

_HALF_US = 2


class Line(NamedTuple):
    """A frame, or what was none, or a note between them.

    Attributes:
        at: When, s on the bench's clock.
        board: Whose wire; "" for a note.
        direction: ``sent`` or ``received``, as the host sees it; "" for a note.
        words: What it says.
        data: The bytes as hexadecimal digits.
    """

    at: float
    board: str
    direction: str
    words: str
    data: str

    def __str__(self) -> str:
        if not self.board:
            return f"{self.at:10.4f}  -- {self.words}"
        arrow = "->" if self.direction == "sent" else "<-"
        return f"{self.at:10.4f}  {arrow} {self.board:<10} {self.words}"


class Contents(NamedTuple):
    """What a journal holds.

    Attributes:
        journal: The file.
        steps: Control steps, those that were made again counted once.
        frames: Pieces that went over wires, by board.
        pairs: New pairs of images.
        seconds: From its first to its last record, on the bench's clock.
        notes: Where it broke off and went on, in words.
        lost: Bytes that are damaged.
        whole: Whether the steps are all that there were.
    """

    journal: str
    steps: int
    frames: dict[str, int]
    pairs: int
    seconds: float
    notes: list[str]
    lost: int = 0
    whole: bool = True

    def lines(self) -> list[str]:
        """In sentences."""
        wires = ", ".join(f"{count} of {board}" for board, count in self.frames.items())
        told = [
            f"{self.journal}: {self.steps} steps, {self.pairs} pairs of images, {self.seconds:.1f} s",
            f"frames: {wires or 'none'}",
        ]
        if self.lost:
            steps = "no step" if self.whole else f"what came after step {self.steps - 1}"
            told.append(f"{self.lost} bytes are damaged: {steps} is lost")
        return told + self.notes


def contents(path: Path) -> Contents:
    """What a journal holds.

    Raises:
        UserError: If it cannot be read.
    """
    records = read_journal(path)
    frames: dict[str, int] = {}
    for record in records:
        if isinstance(record, Wire):
            frames[record.board] = frames.get(record.board, 0) + 1
    steps, whole = whole_steps(records)
    times = [record.at for record in records]
    return Contents(
        shown_path(path),
        len(steps),
        frames,
        sum(step.images is not None for step in steps),
        max(times) - min(times) if times else 0.0,
        [_noted(record) for record in records if isinstance(record, Note)],
        sum(record.count for record in records if isinstance(record, Lost)),
        whole,
    )


def told(path: Path) -> Iterator[Line]:
    """Every frame of a journal in words, in the order of time.

    Raises:
        UserError: If the journal cannot be read.
    """
    for record in read_journal(path):
        if isinstance(record, Wire):
            words = in_words(record.data)
            yield Line(record.at, record.board, record.direction, words, record.data.hex())
        elif isinstance(record, Note):
            yield Line(record.at, "", "", _noted(record), "")
        elif isinstance(record, Lost):
            yield Line(record.at, "", "", f"{record.count} bytes are damaged", "")
        elif isinstance(record, Step):
            yield Line(record.at, "", "", f"step {record.number}", "")


def in_words(data: bytes) -> str:
    """What bytes on a wire say, with their delimiters."""
    parser = Parser()
    frames = parser.feed(data)
    if frames:
        return "; ".join(map(_frame_in_words, frames))
    why = "wrong CRC" if parser.crc else "no frame"
    return f"{why}: {len(data)} bytes" if data.strip(b"\0") else "delimiter"


def _frame_in_words(frame: Frame) -> str:
    kind, reply = frame.type & ~REPLY, bool(frame.type & REPLY)
    try:
        name = Request(kind).name
    except ValueError:
        return f"#{frame.seq} type {frame.type:#04x}, which this version does not know"
    try:
        said = _reply(kind, frame.body) if reply else _request(kind, frame.body)
    except (ValueError, struct.error):
        said = f"a body of {len(frame.body)} bytes that makes no sense"
    return f"#{frame.seq} {name}{' reply' if reply else ''}{f': {said}' if said else ''}"


def _request(kind: int, body: bytes) -> str:
    if kind == Request.HELLO:
        return f"protocol {body[0]}" if body else ""
    if kind == Request.ARM:
        return f"nonce {struct.unpack('<H', body)[0]}"
    if kind == Request.SET:
        return ", ".join(_us(ticks) for (ticks,) in struct.iter_unpack("<H", body))
    if kind == Request.CONFIGURE:
        *ends, slew = (ticks for (ticks,) in struct.iter_unpack("<H", body))
        pairs = zip(ends[::2], ends[1::2], strict=True)
        limits = ", ".join(f"{_us(low)} to {_us(high)}" for low, high in pairs)
        return f"{limits}; {_us(slew)} per 20 ms"
    if kind == Request.NAME:
        return f"'{body.rstrip(bytes(1)).decode('ascii', errors='replace')}'"
    return ""


def _reply(kind: int, body: bytes) -> str:
    if kind == Request.HELLO:
        identity = Identity.decode(body)
        version = ".".join(map(str, identity.firmware))
        return f"'{identity.board_id}' {identity.unique_id}, firmware {version}, nonce {identity.boot_nonce}"
    state = State.decode(body)
    try:
        result = Result(state.result).name.lower().replace("_", " ")
    except ValueError:
        result = f"result {state.result}"
    flags = " ".join(str(flag.name).lower() for flag in Flags if flag in state.flags) or "disarmed"
    pulses = ", ".join(_us(pulse) if pulse else "none" for _, pulse in state.servos)
    x, y, z = (count / 16384 for count in state.acceleration)
    return f"{result}; {flags}; pulses {pulses}; {x:+.3f} {y:+.3f} {z:+.3f} g"


def _us(ticks: int) -> str:
    return f"{ticks / _HALF_US:g} us"


def _noted(note: Note) -> str:
    return f"{note.kind} {note.text}".strip()
