"""What a journal is made of: frames, steps, places and notes, and how each is put into bytes.

Floating-point numbers are kept to the bit.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.parts import Vector

_WIRE = struct.Struct("<dBB")
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


@dataclass(frozen=True)
class Places:
    """Where everybody really is at the end of a step, as far as somebody knows. No student is told.

    Attributes:
        at: When, s on the bench's clock.
        number: Of the step.
        states: Per agent the root's position (m) and quaternion xyzw (7,), and the joints' angles (n,) rad.
    """

    at: float
    number: int
    states: Mapping[str, tuple[Vector, Vector]]


@dataclass(frozen=True)
class Lost:
    """A damaged part of the file, between records that are whole.

    Attributes:
        at: When the last record before it was written, s on the bench's clock.
        count: How many bytes it has.
    """

    at: float
    count: int


Record = Wire | Step | Places | Note | Lost
KINDS = b"WSPN"
"""First bytes of payloads."""


def encoded(record: Wire | Step | Places | Note) -> bytes:
    """A record's payload."""
    if isinstance(record, Wire):
        name = record.board.encode()
        head = _WIRE.pack(record.at, _DIRECTIONS.index(record.direction), len(name))
        return b"W" + head + name + record.data
    if isinstance(record, Note):
        return b"N" + json.dumps({"at": float(record.at), "kind": record.kind, "text": record.text}).encode()
    if isinstance(record, Places):
        states = {name: [base.tolist(), joints.tolist()] for name, (base, joints) in record.states.items()}
        plain = {"at": float(record.at), "number": int(record.number), "states": states}
        return b"P" + json.dumps(plain).encode()
    return _encoded_step(record)


def _encoded_step(step: Step) -> bytes:
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
    return b"S" + struct.pack("<L", len(head)) + head + images


def decoded(payload: bytes) -> Wire | Step | Places | Note:
    """The record of a payload."""
    kind, rest = payload[:1], payload[1:]
    if kind == b"W":
        at, direction, length = _WIRE.unpack_from(rest)
        name, data = rest[_WIRE.size : _WIRE.size + length], rest[_WIRE.size + length :]
        return Wire(at, name.decode(), _DIRECTIONS[direction], data)
    if kind == b"N":
        return Note(**json.loads(rest))
    if kind == b"P":
        plain = json.loads(rest)
        states = {
            name: (np.array(base), np.array(joints)) for name, (base, joints) in plain["states"].items()
        }
        return Places(plain["at"], plain["number"], states)
    return _decoded_step(rest)


def _decoded_step(rest: bytes) -> Step:
    (length,) = struct.unpack_from("<L", rest)
    plain = json.loads(rest[4 : 4 + length])
    for key in ("commands", "tilts"):
        plain[key] = {name: np.array(values, dtype=float) for name, values in plain[key].items()}
    if (shape := plain.pop("images", None)) is not None:
        plain["images"] = np.frombuffer(zlib.decompress(rest[4 + length :]), np.uint8).reshape(shape)
    return Step(**plain)
