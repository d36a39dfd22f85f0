"""A microcontroller with our firmware, in its own terms: pulses in microseconds, refusals by name."""

from __future__ import annotations

import contextlib
import glob
import re
from dataclasses import dataclass

import numpy as np
import serial

from testbed.bodies.parts import Vector
from testbed.errors import UserError
from testbed.hardware.clock import Clock
from testbed.hardware.failures import (
    BoardRestarted,
    LinkLost,
    NotArmed,
    Stopped,
    WentLimp,
    WrongFirmware,
)
from testbed.hardware.line import handshake
from testbed.hardware.line.link import Link, LinkSpec, LinkStatistics, Listener, deaf
from testbed.hardware.line.ports import PortInfo, open_port
from testbed.hardware.line.protocol import Flags, Frame, Identity, Request, Result, State, words
from testbed.hardware.robots.robot import LimpAtTheEnd, connected

TICKS = 2
"""To a microsecond: pulses go over the wire in halves."""
_LARGEST = 0xFFFF
_AWAKE = 0.2  # s; by then a board that has just booted knows its tilt sensor
_FEEDING = 0.1  # s; a board holds after 0.3 of silence
_SPARE_PULSE = 3000  # half us, for a channel that has no servo


@dataclass(frozen=True, kw_only=True)
class Address:
    """Which board, and where.

    Attributes:
        name: The agent's name, for messages and journals.
        unique_id: The board's own id or its USB serial number; where it is plugged in is looked up.
        port: Where it is, if it is not to be looked up; a unique id then is what has to answer there.
        globs: Further places to look for ports.
    """

    name: str
    unique_id: str | None = None
    port: str | None = None
    globs: tuple[str, ...] = ()


class Board(LimpAtTheEnd):
    """One board at the end of a serial line. As a context manager it is limp and let go at the end.

    Args:
        address: Which board.
        servos: How many servos it has to have.
        clock: The bench's.
        listener: Hears all frames.
        link: How patient its link is.
    """

    def __init__(
        self,
        address: Address,
        servos: int,
        clock: Clock,
        *,
        listener: Listener = deaf,
        link: LinkSpec | None = None,
    ) -> None:
        self.address = address
        self.name = address.name
        self._servos = servos
        self._clock = clock
        self._listener = listener
        self._spec = link
        self._link: Link | None = None
        self._identity: Identity | None = None

    @property
    def identity(self) -> Identity:
        """What it said it is when it was connected.

        Raises:
            LinkLost: If it never was.
        """
        return connected(self._identity, self.name)

    @property
    def statistics(self) -> LinkStatistics:
        """Of the link since the port was opened."""
        return self._linked.statistics

    @property
    def port(self) -> serial.Serial:
        """The port where it was found."""
        return self._linked.port

    @property
    def path(self) -> str:
        """That port's name."""
        return self._linked.path

    def connect(self) -> Identity:
        """Find it, make sure that it is the right one, and let it go limp.

        What its watchdog has latched is forgotten; the emergency stop is not.
        """
        self.disconnect()
        port = self.address.port
        self._identity = self._open(PortInfo(port) if port is not None else self._found(None))
        state = self.ask(Request.DISARM)
        if (young := _AWAKE - state.uptime_ms / 1000) > 0:
            self._clock.sleep(young)
            self._identity = handshake.shake_hands(self._linked, self._clock)
        self.ask(Request.CLEAR)
        return self._identity

    def reconnect(self) -> None:
        """Find the same board wherever it is plugged in now and go on; it is never armed by this.

        Raises:
            BoardRestarted: If it has booted since it was connected: everything starts with :meth:`connect` again.
        """
        before = self.identity
        self._close()
        identity = self._open(self._found(before.unique_id))
        if identity.boot_nonce != before.boot_nonce:
            raise self._restarted(identity)

    def limit(self, limits_us: Vector, slew_us: float) -> None:
        """Say between which pulses (servos, 2) us its servos may be, and how much they may change in 20 ms."""
        wanted = np.rint(np.clip(limits_us * TICKS, 0, _LARGEST)).astype(int).tolist()
        low_high = [int(end) for pair in (*wanted, *self.identity.limits[self._servos :]) for end in pair]
        self.ask(Request.CONFIGURE, words([*low_high, round(slew_us * TICKS)]))

    def arm(self) -> None:
        """Allow it to move; no pulse goes out before the first :meth:`drive`.

        Raises:
            Stopped: If the emergency stop is latched.
            BoardRestarted: If it has booted since it was connected.
        """
        self.ask(Request.CLEAR)
        self.ask(Request.ARM, words([self.identity.boot_nonce]))

    def drive(self, pulses_us: Vector) -> State:
        """Send pulses (servos,) us; raises as :meth:`ask` does."""
        ticks = np.rint(np.clip(pulses_us * TICKS, 0, _LARGEST)).astype(int).tolist()
        spare = len(self.identity.limits) - len(ticks)
        return self.ask(Request.SET, words([*ticks, *[_SPARE_PULSE] * spare]))

    def feed(self, pulses_us: Vector, seconds: float) -> State:
        """Send the same pulses for so long, often enough that its watchdog stays quiet; at least once."""
        end = self._clock.now() + seconds
        state = self.drive(pulses_us)
        while (left := end - self._clock.now()) > 0:
            self._clock.sleep(min(_FEEDING, left))
            state = self.drive(pulses_us)
        return state

    def limp(self) -> None:
        """Disarm it: pulses end at once."""
        self.ask(Request.DISARM)

    def rename(self, board_id: str) -> None:
        """Give it another name, which it keeps; it has to be disarmed.

        Raises:
            ValueError: If the name does not fit: 1 to 16 printable ASCII characters.
        """
        if not re.fullmatch(r"[!-~]{1,16}", board_id):
            raise ValueError(f"a board's name has 1 to 16 ASCII characters without spaces, not '{board_id}'")
        self.ask(Request.NAME, board_id.encode().ljust(16, b"\0"))
        self._identity = handshake.shake_hands(self._linked, self._clock)

    def stop(self) -> None:
        """Emergency stop: limp at once, and latched."""
        self.ask(Request.STOP)

    def ask(self, type: Request, body: bytes = b"") -> State:
        """Ask for something and make sure that it was done.

        Raises:
            NotArmed: If it is not armed, or is and should not be.
            WentLimp: If it was left without commands for so long that it let go.
            Stopped: If the emergency stop is latched.
            HardwareFailure: As :meth:`raw` does.
        """
        state = self.raw(type, body)
        if state.result == Result.OK:
            return state
        if state.result == Result.STOPPED or state.flags & Flags.STOPPED:
            raise Stopped(f"the emergency stop of {self.name} is latched")
        if state.result == Result.NOT_ARMED and state.flags & Flags.LATCHED_LIMP:
            raise WentLimp(f"{self.name} heard no command for too long and let its servos go")
        if state.result == Result.NOT_ARMED:
            raise NotArmed(f"{self.name} is not armed")
        if state.result in (Result.ALREADY_ARMED, Result.ONLY_DISARMED):
            raise NotArmed(f"{self.name} is armed, and should not be", "connect it anew, which disarms it")
        if state.result == Result.BAD_VALUE:
            what = f"{self.name} does not accept the values of {type.name}"
            raise WrongFirmware(what, "run 'testbed hardware calibrate servos'")
        raise WrongFirmware(f"{self.name} refuses {type.name}, which it should know (result {state.result})")

    def raw(self, type: Request, body: bytes = b"") -> State:
        """What it replies, unjudged but for this: it is the board that was connected, and has not booted since.

        Raises:
            LinkLost: If it does not answer any more.
            BoardRestarted: If it has booted.
        """
        link, identity = self._linked, self.identity
        try:
            state = State.decode(link.request(type, body, judge=self._whole).body)
        except LinkLost:
            now = self._who_answers()
            if now is not None and now.boot_nonce != identity.boot_nonce:
                raise self._restarted(now) from None
            raise
        if state.boot_nonce != identity.boot_nonce:
            raise self._restarted(self._who_answers())
        return state

    def disconnect(self) -> None:
        """Limp, and let go of the port; harmless when repeated."""
        if self._link is None:
            return
        try:
            with contextlib.suppress(UserError):  # also a journal's, if it cannot be written
                self._link.request(Request.DISARM)
        finally:  # a second Ctrl-C: the firmware's watchdog is the last line
            self._close()

    @property
    def _linked(self) -> Link:
        return connected(self._link, self.name)

    def _whole(self, frame: Frame) -> bool:
        """Whether a reply is a state of this board, and an answer to what was asked rather than to what arrived."""
        try:
            state = State.decode(frame.body)
        except ValueError:
            return False
        return len(state.servos) == len(self.identity.limits) and state.result != Result.BAD_LENGTH

    def _found(self, known: str | None) -> PortInfo:
        """Where the board is; by ``known``, its own id, if its address has none."""
        unique_id = self.address.unique_id or known
        assert unique_id is not None, "a board is given by its unique id or its port"
        port = self.address.port  # maybe it still is there, though no USB port that would be listed
        globs = self.address.globs if port is None else (*self.address.globs, glob.escape(port))
        return handshake.find_board(unique_id, self._clock, globs, name=self.name)

    def _open(self, info: PortInfo) -> Identity:
        port = open_port(info.path)
        self._link = Link(port, self._clock, name=self.name, listener=self._listener, spec=self._spec)
        expected = self.address.unique_id
        if expected is not None and handshake.is_usb_serial(info, expected):
            expected = None  # USB has said it already, and the board has an id of its own
        try:
            identity = handshake.shake_hands(self._link, self._clock)
            handshake.check_board(identity, self.name, expected, self._servos)
        except BaseException:
            self._close()
            raise
        return identity

    def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _who_answers(self) -> Identity | None:
        return handshake.identity_now(self.port, self._clock, self.name, self._listener)

    def _restarted(self, now: Identity | None) -> BoardRestarted:
        cause = f": {handshake.reset_cause(now)}" if now is not None else ""
        return BoardRestarted(f"the board of {self.name} has restarted{cause}")
