"""The time of an emulated bench that runs as a process of its own.

It is ours as long as the machine keeps up. Where it does not, everything that waits for boards and cameras waits in the
bench's time and not in ours, so that a slow machine makes a slow bench and not a bad cable.
"""

from __future__ import annotations

import mmap
import os
import struct
import time
from pathlib import Path

import serial

from testbed.errors import UserError, shown_path
from testbed.hardware.clock import WallClock, readable

_TIME = struct.Struct("<d")
_POLLED = 0.001  # s between two looks at the clock
_PATIENCE = 20.0  # s in which the bench's time does not move at all


class BenchTime(WallClock):
    """The :class:`~testbed.hardware.clock.Clock` of such a bench, read from a file that the bench keeps.

    Args:
        path: The file, as the bench file names it.

    Raises:
        UserError: If it is not there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            with path.open("rb") as file:
                self._shown = mmap.mmap(file.fileno(), _TIME.size, prot=mmap.PROT_READ)
        except (OSError, ValueError) as error:
            raise _gone(path) from error

    def now(self) -> float:
        """See :class:`Clock`."""
        return float(_TIME.unpack_from(self._shown)[0])

    def sleep(self, seconds: float) -> None:
        """See :class:`Clock`."""
        watch, until = _Watch(self), self.now() + seconds
        while (left := until - self.now()) > 0:
            watch.look()
            time.sleep(min(left, _POLLED))

    def wait(self, port: serial.Serial, deadline: float) -> bool:
        """See :class:`Clock`."""
        watch = _Watch(self)
        while not readable(port, _POLLED):
            if self.now() >= deadline:
                return readable(port)
            watch.look()
        return True

    def gone(self) -> UserError:
        """What to say when the bench's time stands still."""
        return _gone(self._path)


class Shown:
    """The file that tells the time, as the bench keeps it."""

    def __init__(self, path: Path) -> None:
        # In place: a clock that another process looks at must stay the same file.
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            os.ftruncate(descriptor, _TIME.size)
            self._shown = mmap.mmap(descriptor, _TIME.size)
        finally:
            os.close(descriptor)

    def tell(self, now: float) -> None:
        """It is so late, in s."""
        _TIME.pack_into(self._shown, 0, now)


class _Watch:
    """Notices that time stands still."""

    def __init__(self, clock: BenchTime) -> None:
        self._clock = clock
        self._last, self._since = clock.now(), time.monotonic()

    def look(self) -> None:
        now = self._clock.now()
        if now != self._last:
            self._last, self._since = now, time.monotonic()
        elif time.monotonic() - self._since > _PATIENCE:
            raise self._clock.gone()


def _gone(path: Path) -> UserError:
    return UserError(
        f"the emulated bench of {shown_path(path)} is not running", "start it: testbed hardware emulate"
    )
