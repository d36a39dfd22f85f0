"""The wire protocol, version 1, as the host speaks it; ``hardware/PROTOCOL.md`` is the whole of it.

A frame is ``COBS(payload + CRC-16/CCITT-FALSE) 0x00`` and a payload ``seq type body``. Nothing here waits or knows
of ports: bytes in, frames out.
"""

from __future__ import annotations

import binascii
import enum
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from cobs import cobs

PROTOCOL = 1
BAUD = 250_000
LARGEST_PAYLOAD = 64
LARGEST_FRAME = LARGEST_PAYLOAD + 2 + 1 + 1
"""With the CRC, the code byte of COBS and the delimiter."""

REPLY = 0x80
NO_IMU_AGE = 255

_IDENTITY = struct.Struct("<B3B16s8sHBBB")
_IDENTITY_END = struct.Struct("<HHH")
_STATE = struct.Struct("<BHHL")
_STATE_END = struct.Struct("<3hB4H")
_PAIR = struct.Struct("<HH")


class Request(enum.IntEnum):
    """What the host can ask."""

    HELLO = 0x01
    ARM = 0x02
    DISARM = 0x03
    SET = 0x04
    READ = 0x05
    STOP = 0x06
    CONFIGURE = 0x07
    NAME = 0x08
    CLEAR = 0x09


class Result(enum.IntEnum):
    """What became of a request."""

    OK = 0
    NOT_ARMED = 1
    STOPPED = 2
    BAD_NONCE = 3
    BAD_LENGTH = 4
    BAD_VALUE = 5
    UNKNOWN_TYPE = 6
    ONLY_DISARMED = 7
    ALREADY_ARMED = 8


class Flags(enum.IntFlag):
    """What a board says about itself in every state."""

    ARMED = 1 << 0
    PULSES = 1 << 1
    HOLDING = 1 << 2
    LATCHED_HELD = 1 << 3
    LATCHED_LIMP = 1 << 4
    STOPPED = 1 << 5
    CLAMPED = 1 << 6
    SLEWING = 1 << 7
    IMU_MISSING = 1 << 8
    IMU_STUCK = 1 << 9


@dataclass(frozen=True)
class Frame:
    """A frame that came through whole."""

    seq: int
    type: int
    body: bytes


def encode(seq: int, type: int, body: bytes = b"") -> bytes:
    """A frame as it goes over the wire, with its delimiter.

    Raises:
        ValueError: If the payload would be too long.
    """
    payload = bytes((seq, type)) + body
    if len(payload) > LARGEST_PAYLOAD:
        raise ValueError(f"a payload of {len(payload)} bytes; at most {LARGEST_PAYLOAD} go into a frame")
    return bytes(cobs.encode(payload + _crc(payload).to_bytes(2, "big"))) + b"\0"


class Parser:
    """Makes frames of bytes, however they are cut, and throws away what is none.

    Attributes:
        crc: How many frames had a wrong CRC ...
        framing: ... and how many were no frames at all.

    Args:
        heard: Told every piece up to its delimiter, good or not, as it came.
    """

    def __init__(self, heard: Callable[[bytes], None] | None = None) -> None:
        self.crc = 0
        self.framing = 0
        self._heard = heard
        self._pending = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that these bytes complete."""
        frames = []
        for byte in data:
            self._pending.append(byte)
            if byte:
                if len(self._pending) >= LARGEST_FRAME:
                    self._too_long = True
                    self._take()
                continue
            piece = self._take()
            if self._too_long:
                self._too_long = False
                self.framing += 1
            elif len(piece) > 1 and (frame := self._frame(piece[:-1])) is not None:
                frames.append(frame)
        return frames

    def _take(self) -> bytes:
        piece = bytes(self._pending)
        self._pending.clear()
        if self._heard is not None:
            self._heard(piece)
        return piece

    def _frame(self, coded: bytes) -> Frame | None:
        try:
            content = cobs.decode(coded)
        except cobs.DecodeError:
            self.framing += 1
            return None
        payload, crc = content[:-2], content[-2:]
        if not 2 <= len(payload) <= LARGEST_PAYLOAD:
            self.framing += 1
            return None
        if _crc(payload) != int.from_bytes(crc, "big"):
            self.crc += 1
            return None
        return Frame(payload[0], payload[1], payload[2:])


@dataclass(frozen=True)
class Identity:
    """What a board says it is.

    Attributes:
        protocol: The version that it speaks.
        firmware: Major, minor, patch.
        board_id: The name that a person gave it.
        unique_id: What tells it from every other one, 16 hexadecimal digits.
        boot_nonce: Another one after each boot.
        reset_cause: The microcontroller's MCUSR: bit 0 power-on, 1 reset pin, 2 brown-out, 3 watchdog.
        imu: 0 without a sensor, else its WHO_AM_I.
        limits: Per servo the least and the greatest pulse in half microseconds.
        slew: Half microseconds per 20 ms.
        hold_ms: Silence after which it holds ...
        limp_ms: ... and goes limp.
    """

    protocol: int
    firmware: tuple[int, int, int]
    board_id: str
    unique_id: str
    boot_nonce: int
    reset_cause: int
    imu: int
    limits: tuple[tuple[int, int], ...]
    slew: int
    hold_ms: int
    limp_ms: int

    @classmethod
    def decode(cls, body: bytes) -> Self:
        """Of a reply to HELLO.

        Raises:
            ValueError: If it is none of this version; its first byte still is the protocol's version.
        """
        if len(body) < _IDENTITY.size or body[0] != PROTOCOL:
            raise ValueError("no identity of this protocol")
        protocol, *firmware, board, unique, nonce, cause, servos, imu = _IDENTITY.unpack_from(body)
        if len(body) != _IDENTITY.size + _PAIR.size * servos + _IDENTITY_END.size:
            raise ValueError(f"an identity of {len(body)} bytes with {servos} servos")
        limits = tuple(_PAIR.iter_unpack(body[_IDENTITY.size : -_IDENTITY_END.size]))
        name = board.rstrip(b"\0").decode("ascii", errors="replace")
        end = _IDENTITY_END.unpack_from(body, len(body) - _IDENTITY_END.size)
        return cls(protocol, tuple(firmware), name, unique.hex(), nonce, cause, imu, limits, *end)

    def encode(self) -> bytes:
        """The body that :meth:`decode` reads."""
        head = _IDENTITY.pack(
            self.protocol,
            *self.firmware,
            self.board_id.encode("ascii"),
            bytes.fromhex(self.unique_id),
            self.boot_nonce,
            self.reset_cause,
            len(self.limits),
            self.imu,
        )
        middle = b"".join(_PAIR.pack(*pair) for pair in self.limits)
        return head + middle + _IDENTITY_END.pack(self.slew, self.hold_ms, self.limp_ms)


@dataclass(frozen=True)
class State:
    """What a board says in reply to everything but HELLO.

    Attributes:
        result: What became of the request; a number that is no :class:`Result` is kept as it is.
        flags: See :class:`Flags`.
        boot_nonce: As in :class:`Identity`.
        uptime_ms: Since it booted.
        servos: Per servo the target as clamped and the pulse as going out now (0: none), half microseconds.
        acceleration: MPU-6050 counts along its own axes, 16384 to a g.
        imu_age_ms: How old that is; 255: there is none.
        counters: CRC errors, framing errors, UART overruns, repeated requests, as the board counts them.
    """

    result: int
    flags: Flags
    boot_nonce: int
    uptime_ms: int
    servos: tuple[tuple[int, int], ...]
    acceleration: tuple[int, int, int]
    imu_age_ms: int
    counters: tuple[int, int, int, int]

    @classmethod
    def decode(cls, body: bytes) -> Self:
        """Of a reply.

        Raises:
            ValueError: If it is no state.
        """
        between = len(body) - _STATE.size - _STATE_END.size
        if between < 0 or between % _PAIR.size:
            raise ValueError(f"a state of {len(body)} bytes")
        result, flags, nonce, uptime = _STATE.unpack_from(body)
        servos = tuple(_PAIR.iter_unpack(body[_STATE.size : _STATE.size + between]))
        x, y, z, age, *counters = _STATE_END.unpack_from(body, len(body) - _STATE_END.size)
        a, b, c, d = counters
        return cls(result, Flags(flags), nonce, uptime, servos, (x, y, z), age, (a, b, c, d))

    def encode(self) -> bytes:
        """The body that :meth:`decode` reads."""
        head = _STATE.pack(self.result, self.flags, self.boot_nonce, self.uptime_ms)
        middle = b"".join(_PAIR.pack(*pair) for pair in self.servos)
        return head + middle + _STATE_END.pack(*self.acceleration, self.imu_age_ms, *self.counters)


def words(values: tuple[int, ...] | list[int]) -> bytes:
    """Numbers as the bodies of SET and CONFIGURE have them: u16 each."""
    return struct.pack(f"<{len(values)}H", *values)


def _crc(payload: bytes) -> int:
    return binascii.crc_hqx(payload, 0xFFFF)
