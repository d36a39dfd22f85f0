"""A cable between an emulated board and a real serial port of this machine, with all that befalls cables.

A pseudo-terminal: pyserial opens its slave side, the bench pumps its master side. Linux moves a pty's bytes in the
background and only makes sure that they have arrived when a reader finds nothing; so both sides read until they
find nothing, which makes an exchange the same each time.
"""

from __future__ import annotations

import contextlib
import os
import pty
import tty
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_MOST_PENDING = 1 << 16  # bytes that nobody reads; a USB adapter keeps a few hundred


@dataclass(frozen=True)
class WireFaults:
    """What a bad cable does to each byte, both ways.

    Attributes:
        drop: Probability that it does not arrive.
        flip: Probability that one of its bits does not arrive as it was.
        double: Probability that it arrives twice.
        delay: Seconds that everything takes longer.
    """

    drop: float = 0.0
    flip: float = 0.0
    double: float = 0.0
    delay: float = 0.0


class Wire:
    """A cable. Its host end is the port ``path``.

    Args:
        link: A name for the port that stays the same when it is unplugged and plugged in again, if any is wanted.
        faults: What it does to bytes; can be changed at any time by setting ``faults``.
        seed: What is left to chance; each direction has chances of its own.

    Attributes:
        lost: How many bytes for the host were thrown away because it did not read.
    """

    def __init__(self, link: Path | None = None, *, faults: WireFaults | None = None, seed: int = 0) -> None:
        self.faults = faults or WireFaults()
        self.lost = 0
        self._link = link
        out, back = np.random.SeedSequence(seed).spawn(2)
        self._to_board = _Lane(np.random.default_rng(out))
        self._to_host = _Lane(np.random.default_rng(back))
        self._master: int | None = None
        self._slave: int | None = None
        self._outgoing = bytearray()
        self.replug()

    @property
    def path(self) -> str:
        """The port's name for pyserial; while it is unplugged, its last one."""
        return str(self._link) if self._link is not None else self._slave_path

    @property
    def plugged(self) -> bool:
        """Whether the cable is in."""
        return self._master is not None

    def from_host(self, now: float) -> bytes:
        """What arrives at the board until ``now`` (s)."""
        if self._master is not None:
            with contextlib.suppress(BlockingIOError):
                while True:
                    self._to_board.put(os.read(self._master, 4096), now, self.faults)
        return self._to_board.take(now)

    def to_host(self, data: bytes, now: float) -> None:
        """Send what the board said at ``now`` (s), and what was under way and has arrived by then."""
        self._to_host.put(data, now, self.faults)
        arrived = self._to_host.take(now)
        if self._master is None:
            return
        self._outgoing += arrived
        while self._outgoing:
            try:
                done = os.write(self._master, self._outgoing)
            except BlockingIOError:
                break
            del self._outgoing[:done]
        if len(self._outgoing) > _MOST_PENDING:
            self.lost += len(self._outgoing) - _MOST_PENDING
            del self._outgoing[_MOST_PENDING:]

    def unplug(self) -> None:
        """Pull the cable out of the host: the port is gone; harmless when repeated."""
        if self.plugged and self._link is not None and self._link.is_symlink():
            self._link.unlink()
        for descriptor in (self._master, self._slave):
            if descriptor is not None:
                os.close(descriptor)
        self._master = self._slave = None
        self._outgoing.clear()
        self._to_board.clear()
        self._to_host.clear()

    def replug(self, link: Path | None = None) -> None:
        """Plug it in again, maybe as another port."""
        self.unplug()
        self._link = link or self._link
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)  # and kept open: a pty without a slave end is a broken pipe
        os.set_blocking(self._master, False)
        self._slave_path = os.ttyname(self._slave)
        if self._link is not None:
            self._link.parent.mkdir(parents=True, exist_ok=True)
            if self._link.is_symlink():
                self._link.unlink()  # of a bench that was killed
            self._link.symlink_to(self._slave_path)

    def close(self) -> None:
        """Like :meth:`unplug`."""
        self.unplug()


class _Lane:
    """One direction of a cable."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._under_way: deque[tuple[float, bytes]] = deque()

    def put(self, data: bytes, now: float, faults: WireFaults) -> None:
        """Bytes start on their way."""
        if data:
            self._under_way.append((now + faults.delay, self._spoilt(data, faults)))

    def take(self, now: float) -> bytes:
        """Bytes that have arrived, in their order."""
        arrived = bytearray()
        while self._under_way and self._under_way[0][0] <= now:
            arrived += self._under_way.popleft()[1]
        return bytes(arrived)

    def clear(self) -> None:
        """What was under way is gone."""
        self._under_way.clear()

    def _spoilt(self, data: bytes, faults: WireFaults) -> bytes:
        if not (faults.drop or faults.flip or faults.double):
            return data
        # As many draws per byte whatever happens to it: the same bytes meet the same fate however they are cut.
        chances = self._rng.random((len(data), 4))
        spoilt = bytearray()
        for byte, (drop, flip, double, bit) in zip(data, chances.tolist(), strict=True):
            if drop < faults.drop:
                continue
            if flip < faults.flip:
                byte ^= 1 << int(bit * 8)
            spoilt += bytes((byte, byte)) if double < faults.double else bytes((byte,))
        return bytes(spoilt)


def garbage(rng: np.random.Generator, count: int) -> bytes:
    """Bytes that mean nothing."""
    noise: NDArray[np.uint8] = rng.integers(0, 256, count, dtype=np.uint8)
    return noise.tobytes()
