"""Time, as everybody on a bench has it: the real one, or the virtual one of an emulated bench.

Nothing in hardware mode asks the operating system for the time or waits by itself. So the same code that waits for a
real cable also waits, in virtual time, for an emulated board, and does so the same way each time.
"""

from __future__ import annotations

import select
import time
from typing import Protocol

import serial


class Clock(Protocol):
    """Tells the time and lets it pass."""

    def now(self) -> float:
        """Seconds since some moment; never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def wait(self, port: serial.Serial, deadline: float) -> bool:
        """Let time pass until a port has something to read or ``deadline`` (s, as :meth:`now`) has come.

        Returns:
            Whether there is something to read; a port that is gone counts, reading it tells so.
        """
        ...


class WallClock:
    """The :class:`Clock` of the real world."""

    def now(self) -> float:
        """See :class:`Clock`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """See :class:`Clock`."""
        time.sleep(max(0.0, seconds))

    def wait(self, port: serial.Serial, deadline: float) -> bool:
        """See :class:`Clock`."""
        return readable(port, max(0.0, deadline - self.now()))


class StillClock:
    """A :class:`Clock` that moves only while somebody sleeps; nothing is plugged in beside it."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """See :class:`Clock`."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """See :class:`Clock`."""
        self._now += seconds

    def wait(self, port: serial.Serial, deadline: float) -> bool:
        """There is no port to wait for."""
        raise NotImplementedError


def readable(port: serial.Serial, seconds: float = 0.0) -> bool:
    """Whether a port has something to read, or does so within so many real seconds; a port that is gone has."""
    try:
        return bool(select.select([port.fileno()], [], [], seconds)[0])
    except (OSError, ValueError, TypeError):  # closed in between
        return True
