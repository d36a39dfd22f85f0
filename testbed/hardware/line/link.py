"""One board at the end of a serial line: a request, its reply, and everything that can happen between.

A request that is not answered in time is sent again with the same number; the board does not do it twice. So what
is lost or garbled costs time and nothing else, and what comes late or twice is thrown away.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import serial

from testbed.hardware.clock import Clock
from testbed.hardware.failures import LinkLost, NoAnswer
from testbed.hardware.line.ports import read_all, write_all
from testbed.hardware.line.protocol import REPLY, Frame, Parser, encode

Direction = Literal["sent", "received"]
Listener = Callable[[float, str, Direction, bytes], None]
"""Hears when (s on the clock), whose line, which way, and the bytes of every frame and of what was none."""


Judge = Callable[[Frame], bool]
"""Says whether a reply can be one; what cannot is garbage, and asked for again."""


def anything(frame: Frame) -> bool:
    """The judge that takes every reply."""
    return True


def deaf(at: float, board: str, direction: Direction, data: bytes) -> None:
    """The listener that does not listen."""


@dataclass(frozen=True, kw_only=True)
class LinkSpec:
    """How patient a link is.

    Attributes:
        timeout: Seconds until a request is sent again. A reply takes 2 ms of line; USB adapters keep bytes for up to
            16 ms. Six times this is less than the 300 ms after which a board holds still.
        retries: How often. With 1% of all bytes garbled one of three exchanges fails, and one of a thousand five
            times more.
        kept_times: How many of the newest round-trip times are kept.
    """

    timeout: float = 0.04
    retries: int = 5
    kept_times: int = 10_000


@dataclass
class LinkStatistics:
    """What has happened on a line so far.

    Attributes:
        sent: Frames sent, retries included.
        received: Replies that were taken.
        retries: Requests sent again.
        lost: Requests given up.
        late: Replies thrown away: to an earlier request, or a second one to the same.
        crc: Frames that came with a wrong CRC.
        framing: Pieces that were no frame.
        misfits: Replies that could not be one.
        times: Round-trip times of the newest exchanges, s; retries count from the first sending.
    """

    sent: int = 0
    received: int = 0
    retries: int = 0
    lost: int = 0
    late: int = 0
    crc: int = 0
    framing: int = 0
    misfits: int = 0
    times: deque[float] = field(default_factory=deque)


class Link:
    """A serial line with a board at its end.

    Attributes:
        statistics: What has happened so far.
        port: The port that was given.

    Args:
        port: An open port, see :func:`testbed.hardware.line.ports.open_port`.
        clock: Whose time passes while we wait.
        name: Whose line this is, for messages and for the listener.
        listener: Hears all that is sent and received.
        spec: How patient it is.
    """

    def __init__(
        self,
        port: serial.Serial,
        clock: Clock,
        *,
        name: str = "board",
        listener: Listener = deaf,
        spec: LinkSpec | None = None,
    ) -> None:
        self.name = name
        self.spec = spec or LinkSpec()
        self.statistics = LinkStatistics(times=deque(maxlen=self.spec.kept_times))
        self.port = port
        self._clock = clock
        self._listener = listener
        self._parser = Parser(lambda piece: listener(clock.now(), name, "received", piece))
        self._seq = 0

    def request(
        self, type: int, body: bytes = b"", *, judge: Judge = anything, retries: int | None = None
    ) -> Frame:
        """Ask, and wait for the reply.

        Args:
            type: See :class:`~testbed.hardware.line.protocol.Request`.
            body: What goes with it.
            judge: Which replies are whole. The CRC does not see a byte that a garbled delimiter has added.
            retries: How often to ask again; as the link's spec says if not given.

        Raises:
            LinkLost: If the port is gone, or nothing is heard any more.
            NoAnswer: If nothing was ever heard.
        """
        self._seq = (self._seq + 1) % 256
        # A delimiter first: whatever was cut off before this frame does not spoil it.
        frame = b"\0" + encode(self._seq, type, body)
        began = self._clock.now()
        more = self.spec.retries if retries is None else retries
        for attempt in range(1 + more):
            self.statistics.retries += attempt > 0
            self._send(frame)
            reply = self._reply(type | REPLY, judge, self._clock.now() + self.spec.timeout)
            if reply is not None:
                self.statistics.received += 1
                self.statistics.times.append(self._clock.now() - began)
                return reply
        self.statistics.lost += 1
        tried = f"{1 + more} requests" if more else "a request"
        if self.statistics.received:
            raise LinkLost(f"{self.name} does not answer any more ({tried}, {self.port.port})")
        raise NoAnswer(f"{self.name} does not answer on {self.port.port} ({tried})")

    @property
    def path(self) -> str:
        """Where the port is."""
        return str(self.port.port)

    def close(self) -> None:
        """Let go of the port; harmless when repeated."""
        self.port.close()

    def _send(self, frame: bytes) -> None:
        # Sent before it is heard: a full disk must not keep back what makes a robot limp.
        write_all(self.port, self.name, frame)
        self.statistics.sent += 1
        self._listener(self._clock.now(), self.name, "sent", frame)

    def _reply(self, type: int, judge: Judge, deadline: float) -> Frame | None:
        found: Frame | None = None
        while found is None and self._clock.wait(self.port, deadline):
            for frame in self._parser.feed(read_all(self.port, self.name)):
                if found is not None or (frame.seq, frame.type) != (self._seq, type):
                    self.statistics.late += 1
                elif judge(frame):
                    found = frame
                else:
                    self.statistics.misfits += 1
            self.statistics.crc, self.statistics.framing = self._parser.crc, self._parser.framing
        return found
