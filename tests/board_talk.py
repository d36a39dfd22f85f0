"""Talking to an emulated board with nothing between: no port, no retries."""

import contextlib
import struct

from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.line.protocol import REPLY, Identity, Parser, Request, Result, State, encode

UNIQUE = bytes(range(1, 9))
REPLY_WAIT = 0.004  # a request of 10 bytes and a reply of 38 take 2 ms


class Talk:
    """A board and the parser of what it says; every request passes 4 ms unless told otherwise."""

    def __init__(self, board=None, **options):
        self.board = board or Microcontroller(
            **{"name": "student", "unique_id": UNIQUE, "noise": 0.001} | options
        )
        self.parser = Parser()
        self.seq = 0
        self.pulses = []
        self.board.run(0.05)

    def frames(self):
        return self.parser.feed(self.board.read())

    def send(self, kind, body=b"", *, seq=None, wait=REPLY_WAIT):
        if seq is None:
            seq = self.seq = (self.seq + 1) % 256
        self.board.write(encode(seq, kind, body))
        self.run(wait)
        return self.frames()

    def ask(self, kind, body=b"", *, seq=None, wait=REPLY_WAIT):
        (frame,) = self.send(kind, body, seq=seq, wait=wait)
        assert frame.type == kind | REPLY
        return (Identity if kind == Request.HELLO else State).decode(frame.body)

    def hello(self):
        return self.ask(Request.HELLO, b"\x01")

    def read(self):
        return self.ask(Request.READ)

    def arm(self, nonce=None):
        return self.ask(Request.ARM, struct.pack("<H", self.hello().boot_nonce if nonce is None else nonce))

    def set(self, *half_us, wait=REPLY_WAIT):
        return self.ask(Request.SET, struct.pack(f"<{len(half_us)}H", *half_us), wait=wait)

    def configure(self, *limits_and_slew):
        return self.ask(Request.CONFIGURE, struct.pack(f"<{len(limits_and_slew)}H", *limits_and_slew))

    def run(self, seconds):
        """Time passes; the pulses that ended are kept in ``pulses``."""
        self.board.run(seconds)
        self.pulses += self.board.pulses()

    def since(self, time, channel=0):
        """The widths (us) of the pulses that began later than this (s)."""
        return [pulse.width_us for pulse in self.pulses if pulse.at > time and pulse.channel == channel]


@contextlib.contextmanager
def talking():
    """A board for one test."""
    talk = Talk()
    yield talk
    talk.board.close()


def armed_with_limits(talk):
    """The same board, allowed to move between 500 and 2500 us, 100 us a frame."""
    assert talk.configure(1000, 5000, 1000, 5000, 200).result == Result.OK
    assert talk.arm().result == Result.OK
    return talk
